"""Scores on a real drive without ground truth: virtual cars hide street that was photographed."""
