//! The adapter against the twins, on whatever frames the bytes make. What is found is written as a sequence.
#![no_main]

use afterimage::{
    gpu::{Gpu, Variant},
    stress::Sketch,
    taa::{PRESETS, Precision},
};
use std::sync::OnceLock;

/// Recipes come again and again, so their passes are compiled once.
fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| {
        let gpu = Gpu::open(None).expect("this target needs an adapter; `twins` needs none");
        gpu.with(Variant {
            cache: Some(Default::default()),
            ..Variant::default()
        })
    })
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((&which, bytes)) = bytes.split_first() else { return };
    let preset = &PRESETS[usize::from(which) % PRESETS.len()];
    let precision = if which & 0x80 == 0 { Precision::F32 } else { Precision::F16 };
    let sketch = Sketch::from_bytes(bytes);
    if let Err(weakness) = sketch.check(&preset.recipe, precision, Some(gpu())) {
        let folder = std::env::temp_dir().join(format!("afterimage-fuzz-gpu-{}", preset.id));
        let written = sketch.write(&folder, preset.id, &preset.recipe);
        panic!("{} {precision:?}: {weakness}; written to {}: {written:?}", preset.id, folder.display());
    }
});
