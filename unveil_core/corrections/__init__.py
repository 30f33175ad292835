"""What a person mended in a clean frame, in that frame and in all others that show the place."""
