# SPDX-License-Identifier: GPL-3.0-or-later
"""Results as files for others, each at one click."""
