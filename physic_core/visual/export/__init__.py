"""Export a reconstruction: the request that an exporter gets, and the files that it returns."""
