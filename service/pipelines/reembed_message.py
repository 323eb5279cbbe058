"""The message of `/version` and the log about a pipeline that has not embedded all files yet."""

REEMBED = "`isoshape reembed` computes the missing embeddings and activates this pipeline."
