"""Backends that run published estimators as ONNX files with onnxruntime."""
