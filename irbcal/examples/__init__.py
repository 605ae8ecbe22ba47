"""What can I try each command with? Small example files, all SIMULATED."""
