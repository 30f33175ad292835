"""Single-image inpainters behind one protocol: PatchMatch, OpenCV's classical methods, networks in ONNX files."""
