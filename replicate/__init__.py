"""The paper: *Fast and Deep Facial Deformations*, a module an idea."""
