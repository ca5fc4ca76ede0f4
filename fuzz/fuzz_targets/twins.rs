//! Every recipe's f32 twin against its f64 twin, on whatever frames the bytes make. What is found is written as a sequence.
#![no_main]

use afterimage::{
    stress::Sketch,
    taa::{PRESETS, Precision},
};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((&which, bytes)) = bytes.split_first() else { return };
    let preset = &PRESETS[usize::from(which) % PRESETS.len()];
    let precision = if which & 0x80 == 0 { Precision::F32 } else { Precision::F16 };
    let sketch = Sketch::from_bytes(bytes);
    if let Err(weakness) = sketch.check(&preset.recipe, precision, None) {
        let folder = std::env::temp_dir().join(format!("afterimage-fuzz-{}", preset.id));
        let written = sketch.write(&folder, preset.id, &preset.recipe);
        panic!("{} {precision:?}: {weakness}; written to {}: {written:?}", preset.id, folder.display());
    }
});
