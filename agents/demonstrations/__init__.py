"""Expert motions to learn from: made, varied, stored, and the ProMP prior fitted to them."""
