"""Inpainters of one image: patches, OpenCV's, networks as ONNX files."""
