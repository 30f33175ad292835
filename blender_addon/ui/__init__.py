# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar. Imports from everything below; nothing imports from here."""
