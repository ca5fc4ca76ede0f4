//! Finding channels in a [`Header`], refusing headers that claim too much, and windows.

use super::error::ImageError;
use super::protocol::{Format, Header, Part, PlaneRequest, SampleType, Window};
use super::{Limits, Plane};
use crate::image::Extent;
use std::path::Path;

impl Format {
    /// What the first bytes of a file say. Extensions are not trusted: a decoder must never see another's files.
    pub(super) fn sniff(start: &[u8]) -> Option<Self> {
        const MAGIC: [(&[u8], Format); 13] = [
            (&[0x76, 0x2f, 0x31, 0x01], Format::Exr),
            (b"\x89PNG\r\n\x1a\n", Format::Png),
            (b"II*\0", Format::Tiff),
            (b"MM\0*", Format::Tiff),
            (b"II+\0", Format::Tiff),
            (b"MM\0+", Format::Tiff),
            (b"SDPX", Format::Dpx),
            (b"XPDS", Format::Dpx),
            (b"#?RADIANCE", Format::Hdr),
            (b"#?RGBE", Format::Hdr),
            (b"\xff\xd8\xff", Format::Jpeg),
            (b"BM", Format::Bmp),
            (b"BA", Format::Bmp),
        ];
        MAGIC
            .iter()
            .find(|(magic, _)| start.starts_with(magic))
            .map(|&(_, format)| format)
    }
}

impl SampleType {
    /// Bytes a stored sample.
    pub(super) fn n_bytes(self) -> u64 {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

impl Window {
    /// Width and height.
    pub fn extent(self) -> Extent {
        Extent::new(self.width, self.height)
    }
}

impl Part {
    /// The channel's name as manifests give it: with the part's name in front where the channel has it not already.
    fn full_name(&self, channel: usize) -> String {
        let channel = &self.channels[channel].name;
        if self.name.is_empty()
            || channel
                .strip_prefix(&*self.name)
                .is_some_and(|rest| rest.starts_with('.'))
        {
            channel.clone()
        } else {
            format!("{}.{channel}", self.name)
        }
    }
}

impl Header {
    /// Full names of all channels, in the file's order: what a manifest may ask for.
    pub fn channel_names(&self) -> Vec<String> {
        self.all()
            .map(|(part, channel)| self.parts[part].full_name(channel))
            .collect()
    }

    /// Finds `wanted`, which may be a channel's name or `part.channel`.
    pub(super) fn locate(&self, path: &Path, wanted: &str) -> Result<PlaneRequest, ImageError> {
        let by_name = self
            .all()
            .find(|&(part, channel)| self.parts[part].channels[channel].name == wanted);
        by_name
            .or_else(|| {
                self.all()
                    .find(|&(part, channel)| self.parts[part].full_name(channel) == wanted)
            })
            .map(|(part, channel)| self.plane(part, channel))
            .ok_or_else(|| ImageError::NoChannel {
                path: path.to_owned(),
                wanted: wanted.to_owned(),
                available: self.list_nearest(wanted),
            })
    }

    /// `R`, `G`, `B`; else those of the only layer that has them; else luminance for all three.
    pub(super) fn locate_rgb(&self, path: &Path) -> Result<[PlaneRequest; 3], ImageError> {
        let at_top = |name: &str| {
            self.all()
                .find(|&(part, channel)| self.parts[part].channels[channel].name == name)
        };
        let mut layers = self.all().filter_map(|(part, channel)| {
            let name = self.parts[part].full_name(channel);
            name.strip_suffix(".R").map(str::to_owned)
        });
        let found = match (at_top("R"), at_top("G"), at_top("B"), layers.next(), layers.next()) {
            (Some(r), Some(g), Some(b), ..) => Some([r, g, b]),
            (.., Some(layer), None) => {
                let rgb = ["R", "G", "B"].map(|name| self.locate(path, &format!("{layer}.{name}")));
                let [r, g, b] = rgb;
                return Ok([r?, g?, b?]);
            }
            (.., None, _) => at_top("Y").map(|y| [y; 3]),
            _ => None,
        };
        found
            .map(|rgb| rgb.map(|(part, channel)| self.plane(part, channel)))
            .ok_or_else(|| ImageError::NoRgb {
                path: path.to_owned(),
                available: self.list_nearest("R"),
            })
    }

    /// Refuses what would take too much memory or time, before anything is allocated for it.
    pub(super) fn check(&self, path: &Path, file_bytes: u64, limits: &Limits) -> Result<(), ImageError> {
        let refuse = |what| {
            Err(ImageError::TooLarge {
                path: path.to_owned(),
                what,
            })
        };
        let max_side = limits.max_side;
        let (mut stored_bytes, mut canvas_bytes) = (0_u64, 0_u64);
        for part in &self.parts {
            for window in [part.data, part.display] {
                let extent = window.extent();
                if extent.width == 0 || extent.height == 0 {
                    return Err(ImageError::damaged(path, format!("claims to be {extent} pixels")));
                }
                if extent.width > max_side || extent.height > max_side {
                    return refuse(format!(
                        "claims to be {extent} pixels; at most {max_side} a side are read"
                    ));
                }
            }
            let pixel_bytes: u64 = part.channels.iter().map(|channel| channel.sample.n_bytes()).sum();
            stored_bytes += pixel_bytes * part.data.extent().n_pixels() as u64;
            canvas_bytes += pixel_bytes * part.display.extent().n_pixels() as u64;
        }
        let n_channels = self.all().count();
        if n_channels > limits.max_channels {
            return refuse(format!(
                "has {n_channels} channels; at most {} are read",
                limits.max_channels
            ));
        }
        let (mib, max_mib) = (stored_bytes.max(canvas_bytes) >> 20, limits.max_bytes >> 20);
        if stored_bytes.max(canvas_bytes) > limits.max_bytes {
            return refuse(format!("claims {mib} MiB of pixels; at most {max_mib} MiB are read"));
        }
        if stored_bytes > file_bytes.saturating_mul(limits.max_expansion) {
            return refuse(format!(
                "claims {stored_bytes} bytes of pixels in a file of {file_bytes}; no compression gives more than {}:1",
                limits.max_expansion
            ));
        }
        Ok(())
    }

    fn all(&self) -> impl Iterator<Item = (usize, usize)> {
        let parts = self.parts.iter().enumerate();
        parts.flat_map(|(part, p)| (0..p.channels.len()).map(move |channel| (part, channel)))
    }

    fn plane(&self, part: usize, channel: usize) -> PlaneRequest {
        PlaneRequest {
            part,
            channel,
            n_pixels: self.parts[part].data.extent().n_pixels(),
            integer: self.parts[part].channels[channel].sample == SampleType::U32,
        }
    }

    fn list_nearest(&self, wanted: &str) -> String {
        const N_LISTED: usize = 12;
        let mut names = self.channel_names();
        // Stable: equally near names keep the file's order.
        names.sort_by(|a, b| {
            let near = |name: &str| strsim::normalized_damerau_levenshtein(name, wanted);
            near(b).total_cmp(&near(a))
        });
        let listed: Vec<String> = names.iter().take(N_LISTED).map(|name| format!("`{name}`")).collect();
        match names.len().saturating_sub(N_LISTED) {
            0 => listed.join(", "),
            n_more => format!("{} and {n_more} more", listed.join(", ")),
        }
    }
}

/// Puts a plane of the data window on a canvas of the display window; pixels without data are 0.
pub(super) fn place(plane: Plane, data: Window, display: Window) -> Plane {
    if data == display {
        return plane;
    }
    match plane {
        Plane::F32(samples) => Plane::F32(place_samples(&samples, data, display)),
        Plane::U32(samples) => Plane::U32(place_samples(&samples, data, display)),
    }
}

fn place_samples<T: Copy + Default>(samples: &[T], data: Window, display: Window) -> Vec<T> {
    let mut canvas = vec![T::default(); display.extent().n_pixels()];
    // Positions are any 32-bit integers, so differences and ends need 64 bits.
    let span = |data_start: i32, data_len: u32, start: i32, len: u32| {
        let offset = i64::from(data_start) - i64::from(start);
        let from = offset.clamp(0, i64::from(len));
        let to = (offset + i64::from(data_len)).clamp(from, i64::from(len));
        (from, to, offset)
    };
    let (x_from, x_to, x_offset) = span(data.x, data.width, display.x, display.width);
    let (y_from, y_to, y_offset) = span(data.y, data.height, display.y, display.height);
    if x_from == x_to {
        return canvas;
    }
    let n_columns = (x_to - x_from) as usize;
    for y in y_from..y_to {
        let source = (y - y_offset) as usize * data.width as usize + (x_from - x_offset) as usize;
        let target = y as usize * display.width as usize + x_from as usize;
        canvas[target..][..n_columns].copy_from_slice(&samples[source..][..n_columns]);
    }
    canvas
}

#[cfg(test)]
mod tests {
    use super::super::protocol::Channel;
    use super::*;

    fn window(x: i32, y: i32, width: u32, height: u32) -> Window {
        Window { x, y, width, height }
    }

    fn header(parts: &[(&str, &[&str])]) -> Header {
        let channel = |name: &&str| Channel {
            name: (*name).to_owned(),
            sample: SampleType::F16,
        };
        let part = |(name, channels): &(&str, &[&str])| Part {
            name: (*name).to_owned(),
            data: window(0, 0, 2, 2),
            display: window(0, 0, 2, 2),
            channels: channels.iter().map(channel).collect(),
        };
        Header {
            parts: parts.iter().map(part).collect(),
        }
    }

    #[test]
    fn a_data_window_is_placed_on_the_display_window() {
        let plane = |data, display| match place(Plane::U32(vec![1, 2, 3, 4]), data, display) {
            Plane::U32(samples) => samples,
            Plane::F32(_) => unreachable!("the kind stays"),
        };
        assert_eq!(
            plane(window(1, 1, 2, 2), window(0, 0, 3, 3)),
            [0, 0, 0, 0, 1, 2, 0, 3, 4]
        );
        assert_eq!(plane(window(-1, -1, 2, 2), window(0, 0, 1, 1)), [4]);
        assert_eq!(plane(window(-1, 0, 2, 2), window(0, 0, 2, 2)), [2, 0, 4, 0]);
        assert_eq!(plane(window(7, 0, 2, 2), window(0, 0, 2, 1)), [0, 0]);
        assert_eq!(plane(window(i32::MIN, 0, 2, 2), window(i32::MAX - 1, 0, 1, 1)), [0]);
    }

    #[test]
    fn channels_are_found_by_either_name_and_the_nearest_is_offered() {
        let path = Path::new("a.exr");
        let blender = header(&[
            ("ViewLayer.Depth", &["ViewLayer.Depth.Z"]),
            ("beauty", &["R", "G", "B"]),
        ]);
        assert_eq!(blender.locate(path, "ViewLayer.Depth.Z").expect("by name").part, 0);
        assert_eq!(blender.locate(path, "beauty.G").expect("by part").channel, 1);
        let message = blender
            .locate(path, "ViewLayer.Depth.V")
            .expect_err("wrong")
            .to_string();
        assert!(
            message.contains("a.exr") && message.contains("there is `ViewLayer.Depth.Z`, "),
            "{message}"
        );
    }

    #[test]
    fn red_green_blue_are_taken_only_where_there_is_no_doubt() {
        let path = Path::new("a.exr");
        let channels = |header: &Header| header.locate_rgb(path).map(|rgb| rgb.map(|plane| plane.channel));
        assert_eq!(
            channels(&header(&[("", &["A", "B", "G", "R", "x.R"])])).expect("plain"),
            [3, 2, 1]
        );
        assert_eq!(
            channels(&header(&[("", &["L.B", "L.G", "L.R", "Z"])])).expect("a layer"),
            [2, 1, 0]
        );
        assert_eq!(channels(&header(&[("", &["Y"])])).expect("grey"), [0, 0, 0]);
        assert!(channels(&header(&[("", &["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"])])).is_err());
        assert!(channels(&header(&[("", &["Z"])])).is_err());
    }

    #[test]
    fn headers_that_claim_too_much_are_refused() {
        let path = Path::new("a.exr");
        let limits = Limits::default();
        let check = |data: Window, display: Window, file_bytes| {
            let mut header = header(&[("", &["R"])]);
            header.parts[0].data = data;
            header.parts[0].display = display;
            header.check(path, file_bytes, &limits)
        };
        let small = window(0, 0, 10, 10);
        assert!(check(small, small, 1).is_ok());
        assert!(check(small, small, 0).is_err());
        assert!(check(small, window(0, 0, 16_384, 16_384), 1 << 30).is_err());
        assert!(check(window(0, 0, 100_000, 1), small, 1 << 30).is_err());
        assert!(check(window(0, 0, 0, 1), small, 1 << 30).is_err());
    }
}
