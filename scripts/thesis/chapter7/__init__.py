"""Chapter 7 of Nubiola 2011 repeated in the virtual cell."""
