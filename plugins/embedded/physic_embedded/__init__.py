"""Default backends: small networks that are part of the package, and a body fit.

No account, download or GPU is needed.

onnxruntime runs the networks.
"""
