# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures that a workspace has of its results. No bpy here."""
