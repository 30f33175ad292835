# SPDX-License-Identifier: GPL-3.0-or-later
"""What a workspace tells of its Gaussians. No bpy here."""
