"""The command line `snake-sim`."""
