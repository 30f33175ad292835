# SPDX-License-Identifier: GPL-3.0-or-later
"""A job from its start to its end: what operators share, the timer that follows it, what is done with what it makes, its log."""
