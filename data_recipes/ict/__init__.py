"""A character that is read and not made: a face in ICT-FaceKit's format, from the folder that `ICT_FACEKIT` names."""
