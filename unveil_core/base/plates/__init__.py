"""Plates of film and effects, OpenEXR and DPX: their numbers in and out as the files have them, and what they mean."""
