# SPDX-License-Identifier: GPL-3.0-or-later
"""What becomes of paths when files are opened, saved and moved."""
