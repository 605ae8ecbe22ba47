"""What ``scripts/fuzz`` does: damaged inputs for every command, and commands that are killed while they write."""
