# SPDX-License-Identifier: GPL-3.0-or-later
"""What a workspace holds, as arrays and plain classes. No bpy, and no import from beside."""
