"""From points and photographs to surfels (``reconstruct``), and again near removed objects (``reoptimize``)."""
