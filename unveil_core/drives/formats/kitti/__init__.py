"""What the readers of the KITTI family share: its text files, sweeps and their motion, and XML with boxes."""
