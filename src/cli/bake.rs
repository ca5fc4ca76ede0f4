//! `afterimage bake`

use super::{lavapipe, note, print, progress_bar, table};
use afterimage::{
    gpu::Gpu,
    image::Extent,
    scene::{BakeObserver, BakeSettings, BakeSummary, Cache, Pattern, SCENES, copy_sequence, gltf::GltfScene},
    sequence::jitter::JitterSequence,
};
use anyhow::Context;
use clap::ValueEnum;
use std::path::PathBuf;

/// Render a built-in scene, or one from a glTF file, to a sequence with a reference
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage bake --list
  afterimage bake atrium --out atrium
  afterimage bake sphere --frames 32 --size 320x180 --disocclusion --out sphere
  afterimage bake foliage --jitter 'halton23(8)' --reference-samples 512 --no-mipmaps --out foliage
  afterimage bake spaceship --size 320x180 --output-size 640x360 --out upscale
  afterimage bake --gltf hall.glb --camera path.json --frames 64 --out hall

Without --out the sequence stays in the cache, and its path is printed. The same settings are baked once: later calls
find them there, under $AFTERIMAGE_CACHE, else $XDG_CACHE_HOME/afterimage, else ~/.cache/afterimage.")]
pub struct Arguments {
    /// Scene to render; `--list` shows all
    #[arg(required_unless_present_any = ["list", "gltf"], conflicts_with = "gltf")]
    scene: Option<String>,
    /// Scene of your own: glTF 2.0, .gltf or .glb
    #[arg(long, value_name = "FILE")]
    gltf: Option<PathBuf>,
    /// Its camera: a JSON file with a path, or the name of one in the file; else the file's first, or one that circles it
    #[arg(long, value_name = "PATH.json|NAME", requires = "gltf")]
    camera: Option<String>,
    /// Its animation, by name or number; else the first
    #[arg(long, value_name = "NAME", requires = "gltf")]
    animation: Option<String>,
    /// Show the scenes there are
    #[arg(long)]
    list: bool,
    /// Number of frames
    #[arg(long, value_name = "N", default_value_t = 16)]
    frames: usize,
    /// Size of the inputs, and of the reference unless --output-size says otherwise
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = parse_size)]
    size: Extent,
    /// Size of the reference, 1 to 4 times --size along each axis
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    output_size: Option<Extent>,
    /// Jitter: none, quincunx2, uniform4_helix or halton23(N)
    #[arg(long, value_name = "SEQUENCE", default_value = "halton23(16)")]
    jitter: JitterSequence,
    /// Factor on the jitter, 0 to 1
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    jitter_scale: f64,
    /// Let time stand still: only jitter and chance differ from frame to frame
    #[arg(long)]
    at_rest: bool,
    /// Shaded samples a pixel of the inputs: 1 or 4
    #[arg(long, value_name = "N", default_value_t = 1)]
    samples: u32,
    /// Samples a pixel of the reference, even; 0 for no reference
    #[arg(long, value_name = "N", default_value_t = 128)]
    reference_samples: u32,
    /// Where the reference's samples lie
    #[arg(long, value_enum, default_value = "stratified")]
    reference_pattern: ReferencePattern,
    /// Also average the reference in the tone-mapped c / (1 + luma): a second manifest, manifest-karis.json, reads it
    #[arg(long)]
    karis: bool,
    /// Seed of the scene's chance and of the reference's samples
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Added to the textures' mip level, for inputs and reference alike
    #[arg(long, value_name = "LEVELS", default_value_t = 0.0, allow_negative_numbers = true)]
    mip_bias: f64,
    /// Read only the finest level of textures
    #[arg(long)]
    no_mipmaps: bool,
    /// Also write which pixels' surfaces the frame before did not see
    #[arg(long)]
    disocclusion: bool,
    /// Folder to write to; missing or empty
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of the cache
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Bake anew what the cache has
    #[arg(long)]
    force: bool,
    /// Adapter, by part of its name or by its index in `list adapters`
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

#[derive(Clone, Copy, ValueEnum)]
enum ReferencePattern {
    Stratified,
    Halton23,
}

fn parse_size(text: &str) -> Result<Extent, String> {
    let sides = text.split_once(['x', '×']);
    let parsed = sides.and_then(|(width, height)| Some(Extent::new(width.parse().ok()?, height.parse().ok()?)));
    parsed.ok_or_else(|| "needs the form WIDTHxHEIGHT, such as 640x360".to_owned())
}

impl Arguments {
    fn settings(&self) -> anyhow::Result<BakeSettings> {
        let gltf = match &self.gltf {
            Some(file) => Some(GltfScene::open(
                file,
                self.camera.as_deref(),
                self.animation.as_deref(),
                self.frames,
            )?),
            None => None,
        };
        Ok(BakeSettings {
            scene: gltf
                .as_ref()
                .map_or_else(|| self.scene.clone().unwrap_or_default(), GltfScene::name),
            gltf,
            n_frames: self.frames,
            render_size: self.size,
            output_size: self.output_size.unwrap_or(self.size),
            at_rest: self.at_rest,
            jitter: self.jitter,
            jitter_scale: self.jitter_scale,
            samples: self.samples,
            reference_samples: self.reference_samples,
            reference_pattern: match self.reference_pattern {
                ReferencePattern::Stratified => Pattern::Stratified,
                ReferencePattern::Halton23 => Pattern::Halton23,
            },
            karis: self.karis,
            seed: self.seed,
            mipmaps: !self.no_mipmaps,
            mip_bias: self.mip_bias,
            disocclusion: self.disocclusion,
        })
    }
}

struct Screen(indicatif::ProgressBar);

impl BakeObserver for Screen {
    fn progress(&self, n_done: usize, n_total: usize) {
        self.0.set_length(n_total as u64);
        self.0.set_position(n_done as u64);
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    if arguments.list {
        list();
        return Ok(true);
    }
    let settings = arguments.settings()?;
    settings.validate()?;
    if let Some(out) = &arguments.out {
        let occupied = out.read_dir().is_ok_and(|mut entries| entries.next().is_some());
        anyhow::ensure!(!occupied, "--out {}: the folder is not empty", out.display());
    }
    lavapipe::without_threads()?;
    let gpu = Gpu::open(arguments.adapter.as_deref())?;
    let cache = Cache::new(arguments.cache.clone().unwrap_or_else(Cache::default_folder));
    let screen = Screen(progress_bar(&settings.scene, settings.n_frames as u64));
    let cached = cache.get(&gpu, &settings, arguments.force, &screen)?;
    screen.0.finish_and_clear();
    match &cached.summary {
        Some(summary) => note(&show(summary, settings.n_frames)),
        None => note("found in the cache; --force bakes it anew"),
    }
    let path = match &arguments.out {
        Some(out) => {
            copy_sequence(&cached.path, out).context("--out")?;
            out
        }
        None => &cached.path,
    };
    print(&format!("{}\n", path.display()));
    Ok(true)
}

fn show(summary: &BakeSummary, n_frames: usize) -> String {
    let times = summary.times;
    let [raster, readback, write, total] =
        [times.raster, times.readback, times.write, summary.elapsed].map(|time| time.as_secs_f64());
    let spent = (raster + readback + write).max(1e-9);
    let percent = |part: f64| 100.0 * part / spent;
    let noise = match summary.noise_floor {
        None => String::new(),
        Some(floor) => format!(
            "; the reference's noise is {:.2e} (linear RMS), {}",
            floor.rms_linear,
            floor
                .psnr_db
                .map_or("none as shown".to_owned(), |psnr| format!("{psnr:.1} dB as shown"))
        ),
    };
    format!(
        "{n_frames} frames in {total:.1} s; of its threads {raster:.1} s rasterising ({:.0} %), {readback:.1} s reading back \
         ({:.0} %), {write:.1} s writing OpenEXR ({:.0} %){noise}",
        percent(raster),
        percent(readback),
        percent(write)
    )
}

fn list() {
    let mut table = table::new(["scene", "purpose", "known"].map(str::to_owned).to_vec(), 3);
    for scene in SCENES {
        table.add_row([scene.id, scene.purpose, scene.known].map(str::to_owned).to_vec());
    }
    print(&format!("{table}\n"));
}
