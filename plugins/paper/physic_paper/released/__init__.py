"""Parts of the released code that differ from the equations of the paper."""
