//! The shape of workgroups. Which one is fastest depends on how an adapter walks memory, so it is measured once
//! (`afterimage bench --tune`) and kept in a file, by adapter and driver. Results never depend on it.

use super::{Gpu, GpuError};
use crate::run::report::AdapterInfo;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, fmt, fs, path::PathBuf, str::FromStr};

/// Invocations along x and y. Written `64x1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Workgroup {
    /// Along x.
    pub x: u32,
    /// Along y.
    pub y: u32,
}

impl Workgroup {
    /// Those that tuning tries: what lies within WebGPU's limit of 256 invocations and is not absurd.
    pub const CANDIDATES: [Self; 6] = [
        Self::new(8, 8),
        Self::new(16, 8),
        Self::new(16, 16),
        Self::new(32, 4),
        Self::new(64, 1),
        Self::new(64, 4),
    ];

    /// A shape of `x` × `y` invocations, whose product divides 256.
    pub const fn new(x: u32, y: u32) -> Self {
        Self { x, y }
    }

    /// How many there are in one.
    pub const fn n_invocations(self) -> u32 {
        self.x * self.y
    }
}

impl fmt::Display for Workgroup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.x, self.y)
    }
}

impl FromStr for Workgroup {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text
            .split_once('x')
            .and_then(|(x, y)| Some((x.parse().ok()?, y.parse().ok()?)));
        match sides {
            Some((x, y)) if x > 0 && y > 0 && x <= 256 && y <= 256 && 256_u32.is_multiple_of(x * y) => {
                Ok(Self { x, y })
            }
            _ => Err(format!(
                "`{text}` is no workgroup: write 8x8 or 64x1; the product must divide 256"
            )),
        }
    }
}

impl TryFrom<String> for Workgroup {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Workgroup> for String {
    fn from(workgroup: Workgroup) -> Self {
        workgroup.to_string()
    }
}

/// What tuning found, by adapter and driver.
type Tuned = BTreeMap<String, Workgroup>;

impl Gpu {
    /// Keeps `workgroup` as this adapter's for every later process; gives the file.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn keep_workgroup(&self, workgroup: Workgroup) -> Result<PathBuf, GpuError> {
        let unwritten = |message: String| GpuError::Device {
            activity: "keeping the workgroup's shape".to_owned(),
            message,
        };
        let path = file().ok_or_else(|| unwritten("neither XDG_CACHE_HOME nor HOME is set".to_owned()))?;
        let mut tuned = read();
        tuned.insert(key(&self.info()), workgroup);
        let text = serde_json::to_string_pretty(&tuned).map_err(|error| unwritten(error.to_string()))?;
        let folder = path.parent().expect("a file in a folder");
        fs::create_dir_all(folder)
            .and_then(|()| fs::write(&path, text))
            .map_err(|error| unwritten(format!("{}: {error}", path.display())))?;
        Ok(path)
    }
}

/// What tuning found for an adapter; none where it never ran. A damaged file counts as none.
pub(super) fn tuned(adapter: &AdapterInfo) -> Option<Workgroup> {
    read().remove(&key(adapter))
}

fn read() -> Tuned {
    let text = file().and_then(|path| fs::read_to_string(path).ok());
    text.and_then(|text| serde_json::from_str(&text).ok())
        .unwrap_or_default()
}

fn key(adapter: &AdapterInfo) -> String {
    format!("{} · {} {}", adapter.name, adapter.driver, adapter.driver_version)
}

fn file() -> Option<PathBuf> {
    let set = |name| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let cache = set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")))?;
    Some(cache.join("afterimage").join("workgroups.json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_written_as_they_are_read() {
        for shape in Workgroup::CANDIDATES {
            assert_eq!(shape.to_string().parse(), Ok(shape));
        }
        for wrong in ["", "8", "8x", "0x8", "64x64", "-1x2", "5x5"] {
            assert!(wrong.parse::<Workgroup>().is_err(), "{wrong}");
        }
    }
}
