"""Scripts for other programs, one file each: they write a rig as a folder of samples for `CHARACTERS`."""
