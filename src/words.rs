//! What readers of text formats say of values, without the names of our types.

/// A message of serde with what is expected in the format's words; `object` is what the format calls named values.
pub fn expected_in_words(message: &str, object: &str) -> String {
    let Some((before, after)) = message.rsplit_once("expected ") else {
        return message.to_owned();
    };
    let end = [" at line", ",", "\n"].iter().filter_map(|end| after.find(end)).min();
    let (expected, rest) = after.split_at(end.unwrap_or(after.len()));
    let words = match expected {
        "a map" => object,
        "a sequence" => "an array",
        "f32" | "f64" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" | "i32" | "i64" => "a whole number",
        other if other.starts_with("struct ") => object,
        other => other,
    };
    format!("{before}expected {words}{rest}")
}

#[cfg(test)]
mod tests {
    use super::expected_in_words;

    #[test]
    fn types_are_not_named() {
        for (message, words) in [
            (
                "invalid type: string \"a\", expected u32 at line 1 column 3",
                "expected a whole number at line 1 column 3",
            ),
            (
                "invalid type: null, expected struct ReportRequest",
                "expected an object",
            ),
            ("invalid type: map, expected a sequence\n", "expected an array\n"),
        ] {
            let found = expected_in_words(message, "an object");
            assert!(found.ends_with(words), "{found}");
        }
        assert_eq!(expected_in_words("missing field `a`", "an object"), "missing field `a`");
    }
}
