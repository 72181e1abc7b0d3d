"""Networks trained on one mesh move another one through its texture coordinates (§6, Fig. 13), scored against truth."""
