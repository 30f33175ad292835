# SPDX-License-Identifier: GPL-3.0-or-later
"""What goes: lists, wire cubes, boxes to click, and the options that a run gets of it. Imports from formats and scene."""
