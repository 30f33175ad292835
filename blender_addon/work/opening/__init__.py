# SPDX-License-Identifier: GPL-3.0-or-later
"""The ways in: a drive is picked or dropped, looked at, shown with what is assumed of it, and imported."""
