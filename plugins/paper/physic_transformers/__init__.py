"""Published estimators through Hugging Face transformers."""
