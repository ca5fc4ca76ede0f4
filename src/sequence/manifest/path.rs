//! Paths of a manifest: relative, inside the sequence's folder, with a frame's number filled in.

use super::FrameEntry;
use serde::{Deserialize, Deserializer, de};
use std::fmt;

/// A relative path such as `input/{file_frame:04}.exr`. `{file_frame}` and `{index}` are known, and `{sample}` or `{layer}`
/// where pixels have several; `:04` pads with zeros to four digits, and any width will do. Without a placeholder every frame
/// shares the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathTemplate {
    text: String,
    segments: Vec<Segment>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Segment {
    Literal(String),
    Number { of: Number, width: usize },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    FileFrame,
    Index,
    /// Of a sample or a layer, as the word says.
    Item(&'static str),
}

impl PathTemplate {
    /// Parses `text`; the error says what is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        stay_inside(text)?;
        let mut segments = Vec::new();
        let mut rest = text;
        while let Some(start) = rest.find(['{', '}']) {
            let (literal, braced) = rest.split_at(start);
            let (name, after) = braced
                .strip_prefix('{')
                .and_then(|braced| braced.split_once('}'))
                .ok_or_else(|| format!("`{text}` has a brace without its partner"))?;
            if !literal.is_empty() {
                segments.push(Segment::Literal(literal.to_owned()));
            }
            segments.push(placeholder(name)?);
            rest = after;
        }
        if !rest.is_empty() {
            segments.push(Segment::Literal(rest.to_owned()));
        }
        Ok(Self {
            text: text.to_owned(),
            segments,
        })
    }

    /// Whether it holds the number of a sample or layer under this name.
    pub fn numbers_items_as(&self, name: &str) -> bool {
        let is_it = |segment: &Segment| matches!(segment, Segment::Number { of: Number::Item(of), .. } if *of == name);
        self.segments.iter().any(is_it)
    }

    /// The path for one frame and one of its samples or layers; none when the template asks for a `file_frame` that the frame does not give.
    pub fn for_frame(&self, frame: &FrameEntry, item: usize) -> Option<String> {
        let mut path = String::new();
        for segment in &self.segments {
            match segment {
                Segment::Literal(text) => path.push_str(text),
                Segment::Number { of, width } => {
                    let number = match of {
                        Number::FileFrame => frame.file_frame?,
                        Number::Index => frame.index as u64,
                        Number::Item(_) => item as u64,
                    };
                    path.push_str(&format!("{number:0width$}"));
                }
            }
        }
        Some(path)
    }
}

fn placeholder(name: &str) -> Result<Segment, String> {
    let (number, format) = name.split_once(':').unwrap_or((name, "0"));
    let of = match number {
        "file_frame" => Number::FileFrame,
        "index" => Number::Index,
        "sample" => Number::Item("sample"),
        "layer" => Number::Item("layer"),
        _ => {
            return Err(format!(
                "`{{{name}}}` is unknown; use {{file_frame:04}} or {{index:04}}"
            ));
        }
    };
    match format.strip_prefix('0').map(|digits| (digits, digits.parse())) {
        Some(("", _)) => Ok(Segment::Number { of, width: 0 }),
        Some((_, Ok(width @ 0..=20))) => Ok(Segment::Number { of, width }),
        _ => Err(format!(
            "`{{{name}}}`: the format is a 0 and a width up to 20, such as {{{number}:04}}"
        )),
    }
}

/// Every component is a plain name, so that the path cannot climb out of the folder and has one spelling only.
fn stay_inside(text: &str) -> Result<(), String> {
    let has_drive = text.as_bytes().get(1) == Some(&b':');
    if text.starts_with('/') || text.contains(['\\', '\0']) || has_drive {
        return Err(format!(
            "`{text}` must be relative to the manifest's folder, with / between names"
        ));
    }
    match text.split('/').find(|name| matches!(*name, "" | "." | "..")) {
        Some("..") => Err(format!("`{text}` leaves the sequence's folder; paths must stay inside")),
        Some(name) => Err(format!("`{text}` has `{name}` between slashes; write plain names")),
        None => Ok(()),
    }
}

impl fmt::Display for PathTemplate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl<'de> Deserialize<'de> for PathTemplate {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::parse(&String::deserialize(deserializer)?).map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(index: usize, file_frame: Option<u64>) -> FrameEntry {
        FrameEntry {
            index,
            file_frame,
            jitter: [0.0; 2],
            reset: false,
            exposure: None,
            camera: None,
        }
    }

    #[test]
    fn numbers_are_filled_in_with_any_width() {
        for (template, expected) in [
            ("input/{file_frame:04}.exr", "input/0017.exr"),
            ("{index:02}/{file_frame}.png", "03/17.png"),
            ("{index:08}.exr", "00000003.exr"),
            ("still.exr", "still.exr"),
            ("{index}/{sample:02}.exr", "3/05.exr"),
            ("{layer}.exr", "5.exr"),
        ] {
            let path = PathTemplate::parse(template).unwrap().for_frame(&frame(3, Some(17)), 5);
            assert_eq!(path.as_deref(), Some(expected));
        }
        let numbered = PathTemplate::parse("{file_frame}.exr").unwrap();
        assert_eq!(numbered.for_frame(&frame(0, None), 0), None);
    }

    #[test]
    fn bad_paths_are_refused_by_name() {
        for (template, problem) in [
            ("../secret.exr", "leaves the sequence's folder"),
            ("a/../../b.exr", "leaves the sequence's folder"),
            ("/etc/passwd", "must be relative"),
            ("C:/a.exr", "must be relative"),
            ("a\\b.exr", "must be relative"),
            ("a//b.exr", "plain names"),
            ("./a.exr", "plain names"),
            ("", "plain names"),
            ("{frame:04}.exr", "`{frame:04}` is unknown"),
            ("{index:4}.exr", "a 0 and a width"),
            ("{index:099}.exr", "a 0 and a width"),
            ("{index.exr", "brace"),
            ("index}.exr", "brace"),
        ] {
            let error = PathTemplate::parse(template).unwrap_err();
            assert!(error.contains(problem), "{template}: {error}");
        }
    }
}
