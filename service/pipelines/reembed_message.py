"""What `/version` and the log say of a pipeline that not all files are embedded by yet."""

REEMBED = "`isoshape reembed` computes the missing embeddings and activates this pipeline."
