"""Drawn faces registered to the frames they were drawn in, without any camera: the way to follow what cameras cannot explain."""
