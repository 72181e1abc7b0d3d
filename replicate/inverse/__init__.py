"""Control points in, a face out: inverse kinematics through a differentiable approximation (§4), and what it is for."""
