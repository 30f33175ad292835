# SPDX-License-Identifier: GPL-3.0-or-later
"""Other ways to all that the sidebar has: a menu, whose entries can be searched for, and keys."""
