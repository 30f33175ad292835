"""render(): the public face of the rasterizer. (contract; the rasterizer work fills it in)

    render(surfels, camera, outputs={"rgb", "alpha"}, *, label_count=None, backend="auto") -> Rendered

``outputs`` is a set of plane names out of PLANES. Planes that are not asked for are None and cost nothing.
"""
