//! The one error of the API: RFC 9457 problem details with a stable `code`. Causes that the caller cannot act on go to
//! the log, never into the answer.

use crate::{bench::BenchError, run::RunError, store::StoreError};
use axum::{
    Json,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;
use std::time::Duration;

/// Why a request was refused or failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ApiError {
    status: StatusCode,
    code: &'static str,
    detail: String,
    field: Option<String>,
    missing: Vec<String>,
    retry_after: Option<Duration>,
}

/// `application/problem+json`. The type is `about:blank`, so the title is the status's own phrase; what programs match
/// on is `code`.
#[derive(Serialize)]
struct Problem<'a> {
    r#type: &'static str,
    title: &'static str,
    status: u16,
    code: &'static str,
    detail: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    field: Option<&'a str>,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    missing: &'a [String],
}

impl ApiError {
    /// An error with a stable `code` and a `detail` that says what to do.
    pub fn new(status: StatusCode, code: &'static str, detail: impl Into<String>) -> Self {
        Self {
            status,
            code,
            detail: detail.into(),
            field: None,
            missing: Vec::new(),
            retry_after: None,
        }
    }

    /// A request whose content is wrong.
    pub fn invalid(code: &'static str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, code, detail)
    }

    /// Something that is not there.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not_found", detail)
    }

    /// Our own failure. The cause is logged, not shown.
    pub fn internal(cause: impl std::fmt::Display) -> Self {
        tracing::error!(%cause, "request failed");
        Self::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "internal",
            "the service failed to answer; its log has the cause",
        )
    }

    /// Names the field of the request that is wrong.
    pub fn field(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// Says in which object of the body the field is.
    pub fn within(mut self, object: &str) -> Self {
        self.field = self.field.map(|field| format!("{object}.{field}"));
        self
    }

    /// Names what must be put first.
    pub fn missing(mut self, missing: Vec<String>) -> Self {
        self.missing = missing;
        self
    }

    /// Says when to try again.
    pub fn retry_after(mut self, wait: Duration) -> Self {
        self.retry_after = Some(wait);
        self
    }

    /// More work waits than is done.
    pub fn busy(detail: impl Into<String>, wait: Duration) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail).retry_after(wait)
    }

    /// A body beyond the limit.
    pub fn body_too_large() -> Self {
        Self::new(
            StatusCode::PAYLOAD_TOO_LARGE,
            "body_too_large",
            "the JSON body is larger than this service accepts (--max-json-kib)",
        )
    }

    /// What the pages show as their title.
    pub fn status(&self) -> StatusCode {
        self.status
    }

    /// What to tell a person.
    pub fn detail(&self) -> &str {
        &self.detail
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let problem = Problem {
            r#type: "about:blank",
            title: self.status.canonical_reason().unwrap_or_default(),
            status: self.status.as_u16(),
            code: self.code,
            detail: &self.detail,
            field: self.field.as_deref(),
            missing: &self.missing,
        };
        let mut response = (self.status, Json(problem)).into_response();
        let media_type = HeaderValue::from_static("application/problem+json");
        response.headers_mut().insert(header::CONTENT_TYPE, media_type);
        if let Some(wait) = self.retry_after {
            let seconds = wait.as_secs_f64().ceil().max(1.0) as u64;
            response
                .headers_mut()
                .insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Busy => Self::busy(error.to_string(), Duration::from_secs(1)),
            StoreError::NoReport(_) => Self::not_found(error.to_string()),
            StoreError::NoFrames(_) => Self::invalid("no_numbers", error.to_string()),
            StoreError::Closed(_) => Self::new(StatusCode::CONFLICT, "report_complete", error.to_string()),
            other => Self::internal(other),
        }
    }
}

impl From<BenchError> for ApiError {
    fn from(error: BenchError) -> Self {
        match error {
            BenchError::Input { field, message } => {
                Self::invalid("invalid_bench", message).field(format!("bench.{field}"))
            }
            BenchError::Run(error) => Self::from(error).within("bench"),
        }
    }
}

impl From<RunError> for ApiError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Input(detail) => {
                let field = named_field(&detail).map(str::to_owned);
                let invalid = Self::invalid("invalid_job", detail);
                field.into_iter().fold(invalid, Self::field)
            }
            other => Self::internal(other),
        }
    }
}

/// The field that words begin with: `presets[1]: …`, `limit: …`; or that is no field or missing, as serde says it.
pub fn named_field(words: &str) -> Option<&str> {
    let is_plain = |name: &str| {
        let plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"_.[]".contains(&byte);
        !name.is_empty() && name.bytes().all(plain)
    };
    let in_ticks = || {
        let rest = words
            .strip_prefix("missing field `")
            .or(words.strip_prefix("unknown field `"))?;
        Some(rest.split_once('`')?.0)
    };
    words
        .split_once(": ")
        .map(|(name, _)| name)
        .filter(|name| is_plain(name))
        .or_else(in_ticks)
}

#[cfg(test)]
mod tests {
    use super::named_field;

    #[test]
    fn fields_are_named_where_words_begin_with_them() {
        for (words, field) in [
            ("limit: invalid digit found in string", Some("limit")),
            ("presets[14]: `checkerboard` fills gaps", Some("presets[14]")),
            ("missing field `metric`", Some("metric")),
            ("unknown field `lmit`, expected one of `status`, `limit`", Some("lmit")),
            ("frame 0, reference: not an image", None),
            ("/data/x.exr: not an image", None),
            ("nothing at all", None),
        ] {
            assert_eq!(named_field(words), field, "{words}");
        }
    }
}
