"""Pictures of shapes: thumbnails, and meshes as browsers show them."""
