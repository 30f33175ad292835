# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of settings, as the command has it. No bpy here."""
