"""Scripts for other programs, a file each: they write a rig as the folder of samples that `CHARACTERS` takes."""
