"""From footage alone to a drive: frames out of a clip or folder, cameras and points by structure from motion, metres and up."""
