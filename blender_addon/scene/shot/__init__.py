# SPDX-License-Identifier: GPL-3.0-or-later
"""A shot read from the scene: the active camera, the plates behind it, and points that are known."""
