//! The only module besides `taa`, `scene` and GPU metrics that names wgpu: adapter, passes, textures, timestamps.

/// An adapter, its device and its queue. One a process (lavapipe leaks devices).
pub struct Gpu {}
