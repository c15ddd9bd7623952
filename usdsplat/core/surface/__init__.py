"""Convert surfaces to triangles: polygons, subdivision surfaces, USD's geometric primitives."""
