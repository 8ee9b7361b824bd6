"""Profiles for one wearer: trials on the worn arm, a search that only ever takes away, the file with what it found."""
