"""A world's tables into a rerun recording, to be played in space (`mdkf view`)."""
