"""How each joint behaves (Nubiola 2011, chapter 4): from moves of one joint, or from the residuals of any poses."""
