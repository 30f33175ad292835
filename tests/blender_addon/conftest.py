"""What needs bpy runs in processes of its own, see ``run_in_blender.py``."""

collect_ignore = ["in_blender"]
