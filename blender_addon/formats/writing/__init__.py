# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders that are written as a whole, and what is known of what was written there."""
