//! Addresses: queries in which a name may stand several times, as forms send what is ticked, and links with such queries.

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};

const KEPT: &AsciiSet = &NON_ALPHANUMERIC
    .remove(b'-')
    .remove(b'_')
    .remove(b'.')
    .remove(b'~')
    .remove(b':');

/// A query's names and values in order; values that are empty are left out, because forms send those too.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Query(Vec<(String, String)>);

impl Query {
    /// Reads what follows the question mark.
    pub fn parse(text: Option<&str>) -> Self {
        let decode = |text: &str| {
            percent_decode_str(&text.replace('+', " "))
                .decode_utf8_lossy()
                .into_owned()
        };
        let pairs = text
            .unwrap_or_default()
            .split('&')
            .filter_map(|pair| pair.split_once('='));
        Self(
            pairs
                .map(|(name, value)| (decode(name), decode(value)))
                .filter(|(_, value)| !value.is_empty())
                .collect(),
        )
    }

    /// Every value of a name.
    pub fn all(&self, name: &str) -> Vec<String> {
        let of_name = self.0.iter().filter(|(known, _)| known == name);
        of_name.map(|(_, value)| value.clone()).collect()
    }

    /// The first value of a name.
    pub fn one(&self, name: &str) -> Option<&str> {
        self.0
            .iter()
            .find(|(known, _)| known == name)
            .map(|(_, value)| value.as_str())
    }

    /// The first value of a name, where it is of this type.
    pub fn number<T: std::str::FromStr>(&self, name: &str) -> Option<T> {
        self.one(name)?.parse().ok()
    }
}

/// `path` with a query of these; pairs without a value are left out.
pub fn href<'a>(path: &str, pairs: impl IntoIterator<Item = (&'a str, Option<String>)>) -> String {
    let pairs: Vec<String> = pairs
        .into_iter()
        .filter_map(|(name, value)| Some(format!("{name}={}", utf8_percent_encode(&value?, KEPT))))
        .collect();
    if pairs.is_empty() {
        return path.to_owned();
    }
    format!("{path}?{}", pairs.join("&"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let value = "karis2014, current_weight 0.2 & <more>";
        let text = href("/trends", [("recipe", Some(value.to_owned())), ("branch", None)]);
        assert_eq!(
            Query::parse(text.split_once('?').map(|(_, query)| query)).one("recipe"),
            Some(value)
        );
        let query = Query::parse(Some("metric=psnr&metric=ssim&branch=&from=7"));
        assert_eq!(query.all("metric"), ["psnr", "ssim"]);
        assert_eq!((query.one("branch"), query.number("from")), (None, Some(7_i64)));
    }
}
