"""Linear blend skinning fitted to poses: smooth skinning decomposition with rigid bones (SSDR; Le and Deng 2012)."""
