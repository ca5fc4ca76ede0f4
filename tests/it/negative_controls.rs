//! negative_controls
