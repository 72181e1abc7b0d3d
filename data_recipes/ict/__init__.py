"""A face in ICT-FaceKit's format, read from the folder that `ICT_FACEKIT` names."""
