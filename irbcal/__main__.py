"""``python -m irbcal``."""

from irbcal.cli.main import main

main()
