"""nuScenes: its tables of JSON, streamed, and the drive that they describe."""
