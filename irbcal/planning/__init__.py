"""Planning: which poses to measure, and the files that carry a plan out."""
