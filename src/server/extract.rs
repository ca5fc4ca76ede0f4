//! Extractors whose refusals are [`ApiError`]s, so that a client meets one form of error whatever it did wrong.

use super::{ApiError, error::named_field};
use crate::words::expected_in_words;
use axum::{
    body::Bytes,
    extract::{FromRequest, FromRequestParts, OriginalUri, Path, Query, Request, rejection::BytesRejection},
    http::{StatusCode, header, request::Parts},
};
use serde::{
    Deserialize, Deserializer,
    de::{DeserializeOwned, Error as _, MapAccess, Visitor},
};
use std::{collections::BTreeMap, fmt, marker::PhantomData};

/// A JSON body.
pub struct ApiJson<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for ApiJson<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        // Beyond form's sake: a page of another origin can make a browser post text, but not JSON.
        let media_type = request
            .headers()
            .get(header::CONTENT_TYPE)
            .and_then(|value| value.to_str().ok());
        let media_type = media_type.and_then(|value| value.split(';').next()).unwrap_or_default();
        if !media_type.trim().eq_ignore_ascii_case("application/json") {
            return Err(ApiError::new(
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "not_json",
                "send the body as JSON, with the header `content-type: application/json`",
            ));
        }
        let bytes = Bytes::from_request(request, state).await.map_err(body_error)?;
        // Fields by their place, which serde would take, too.
        if bytes.trim_ascii_start().starts_with(b"[") {
            return Err(ApiError::invalid(
                "invalid_field",
                "the body must be an object, not an array",
            ));
        }
        let mut deserializer = serde_json::Deserializer::from_slice(&bytes);
        let value = serde_path_to_error::deserialize(&mut deserializer).map_err(json_error)?;
        deserializer
            .end()
            .map_err(|error| ApiError::new(StatusCode::BAD_REQUEST, "bad_json", error.to_string()))?;
        Ok(Self(value))
    }
}

/// A body that is too long or broke off.
pub fn body_error(rejection: BytesRejection) -> ApiError {
    match rejection.status() {
        StatusCode::PAYLOAD_TOO_LARGE => ApiError::body_too_large(),
        status => ApiError::new(status, "bad_body", rejection.body_text()),
    }
}

/// Text that is no JSON is a bad request; JSON of the wrong shape is invalid, and names its field.
fn json_error(error: serde_path_to_error::Error<serde_json::Error>) -> ApiError {
    let (path, inner) = (error.path().to_string(), error.inner());
    if !inner.is_data() {
        return ApiError::new(StatusCode::BAD_REQUEST, "bad_json", inner.to_string());
    }
    let message = expected_in_words(&inner.to_string(), "an object");
    let code = match &message {
        text if text.starts_with("unknown field") => "unknown_field",
        text if text.starts_with("missing field") => "missing_field",
        _ => "invalid_field",
    };
    // Of a field that is missing or comes twice, the path leads to where it should be.
    let is_within = ["missing field", "duplicate field"]
        .iter()
        .any(|start| message.starts_with(start));
    let name = message.split('`').nth(1).filter(|_| is_within).map(str::to_owned);
    let parent = Some(path).filter(|path| path != ".");
    let field: Vec<String> = parent.into_iter().chain(name).collect();
    let invalid = ApiError::invalid(code, message);
    match field.is_empty() {
        true => invalid,
        false => invalid.field(field.join(".")),
    }
}

/// Query parameters.
pub struct ApiQuery<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for ApiQuery<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        match Query::from_request_parts(parts, state).await {
            Ok(Query(value)) => Ok(Self(value)),
            Err(rejection) => {
                let text = rejection.body_text();
                let detail = text.split_once(": ").map_or(text.as_str(), |(_, detail)| detail);
                let refused = ApiError::new(StatusCode::BAD_REQUEST, "bad_query", detail);
                Err(named_field(detail).into_iter().fold(refused, ApiError::field))
            }
        }
    }
}

/// Parts of the path.
pub struct ApiPath<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for ApiPath<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        match Path::from_request_parts(parts, state).await {
            Ok(Path(value)) => Ok(Self(value)),
            Err(_) => {
                let nested = parts.extensions.get::<OriginalUri>();
                let uri = nested.map_or(&parts.uri, |OriginalUri(uri)| uri);
                Err(ApiError::not_found(format!("there is nothing at {}", uri.path())))
            }
        }
    }
}

/// Values by name. A name that comes twice is refused: which of its values was meant, nobody can say.
pub fn by_name<'de, D: Deserializer<'de>, V: Deserialize<'de>>(json: D) -> Result<BTreeMap<String, V>, D::Error> {
    struct Values<V>(PhantomData<V>);

    impl<'de, V: Deserialize<'de>> Visitor<'de> for Values<V> {
        type Value = BTreeMap<String, V>;

        fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
            formatter.write_str("a map")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut json: A) -> Result<Self::Value, A::Error> {
            let mut values = BTreeMap::new();
            while let Some((name, value)) = json.next_entry::<String, V>()? {
                if values.contains_key(&name) {
                    return Err(A::Error::custom(format_args!("`{name}` appears twice")));
                }
                values.insert(name, value);
            }
            Ok(values)
        }
    }

    json.deserialize_map(Values(PhantomData))
}
