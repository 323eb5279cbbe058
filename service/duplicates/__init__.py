"""Near-identical shapes among those stored: copies that are turned, scaled, mirrored or meshed anew."""
