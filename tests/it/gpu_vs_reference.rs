//! gpu_vs_reference
