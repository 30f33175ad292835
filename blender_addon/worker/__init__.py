# SPDX-License-Identifier: GPL-3.0-or-later
"""The work outside Blender: processes, what they tell, and the Python that they run in. No bpy, and no import from beside."""
