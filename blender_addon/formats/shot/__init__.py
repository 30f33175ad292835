# SPDX-License-Identifier: GPL-3.0-or-later
"""A shot of the artist's own scene on its way to a drive on disk. No bpy here."""
