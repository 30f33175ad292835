"""Segmentation networks in ONNX files: settings, classes, inputs, outputs, windows."""
