"""Our own method: V = V⁰ + Σ_r (mean_r + c_r(p) B_r), a basis and a network a region of the face. Its ideas, in order:

Regions of the mesh, each compact                        regional/basis.py: split_regions
A metric of offsets that sees what Eq. 1 sees            regional/basis.py: loss_metric
Bases B_r whose components are principal in it           regional/basis.py: principal_basis
Components in 16 and 8 bits                              regional/model.py: store
Coefficients of training samples, by projection          regional/basis.py: projection
Regions that overlap, one fading into the other          regional/basis.py: blend_weights
How a basis moves vertices beyond its region             regional/model.py: blended
A network sees the controls that move its region         methods/regional.py: parameters_of
Layers that are products, silu(x U) ∘ (x V)              regional/networks.py: GatedNetwork
A straight line beside them, from ridge regression       methods/regional.py: start
No product leaves the range that training has seen       regional/networks.py: GatedNetwork.bound
The loss: lengths of the regions' coefficient errors     regional/model.py: regional_loss
The training, by the loop of all networks                methods/regional.py: train
The rig's exact derivatives, for Sobolev training        methods/regional.py: derivative_batches
That variant as a row of the tables                      methods/regional_derivatives.py: stage
From p to offsets, batch by batch                        regional/model.py: RegionalModel.offsets
The same for one pose at a time, compiled                inference/regional_evaluation.py: place_regions
The same at a few vertices, for inverse kinematics       inverse/at_vertices.py: RegionalPoints
The same as an ONNX graph                                deployment/onnx_offsets.py: add_offsets
The same as one C file                                   deployment/c_face.py
The same in the posing page                              poser/front/regional.js
A trained model with fewer shapes, in a smaller file     targets/trained_models.py: with_fewer_shapes

`methods/regional.py` is the place to begin: its `train` goes through all of it from top to bottom. What each choice is
worth is in notebooks/bench_regional.ipynb, by `make bench-regional`.
"""
