# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of the preferences: a state, and one button that installs."""
