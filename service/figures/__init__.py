"""The paper's figures, drawn anew from meshes, matches and scores."""
