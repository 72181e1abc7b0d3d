"""Triangle meshes: normals, edges, rays, rigid alignment."""
