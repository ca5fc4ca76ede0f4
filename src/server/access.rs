//! Who may do what. A token comes as `Authorization: Bearer`, or as the password of `Basic`, which is how a browser asks
//! for one. A service that only this machine can reach asks for none unless told to; a token that is sent counts anyway.

use super::{ApiError, Service, api::Scopes};
use crate::store::{Scope, Timestamp, Token, token_hash};
use axum::{
    body::Body,
    extract::{MatchedPath, State},
    http::{HeaderMap, Request, StatusCode, header, request::Parts},
    middleware::Next,
    response::{IntoResponse as _, Response},
};
use base64::Engine as _;
use std::{
    collections::HashMap,
    net::IpAddr,
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

/// How long a token that was looked up is believed; a revoked one works at most so much longer.
const BELIEVED: Duration = Duration::from_secs(2);
/// More tokens than this are not remembered at once.
const MAX_REMEMBERED: usize = 1000;

/// Who sent a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caller {
    /// The token's number; 0 for none.
    pub token_id: i64,
    /// The token's name.
    pub name: Option<String>,
}

impl<S: Send + Sync> axum::extract::FromRequestParts<S> for Caller {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let caller = parts.extensions.get::<Self>().cloned();
        caller.ok_or_else(|| ApiError::internal("a route without access control"))
    }
}

/// What is known of tokens in use.
#[derive(Default)]
pub struct Access {
    known: Mutex<HashMap<[u8; 32], Known>>,
    scopes: Scopes,
}

struct Known {
    token: Token,
    read_at: Instant,
    bucket: Bucket,
}

/// Fills at the token's rate, holds ten seconds' worth, and at least one request.
struct Bucket {
    level: f64,
    at: Instant,
}

impl Bucket {
    /// Takes one request, or says how long to wait.
    fn take(&mut self, rate_per_minute: u32, now: Instant) -> Result<(), Duration> {
        let per_second = f64::from(rate_per_minute) / 60.0;
        let full = (10.0 * per_second).max(1.0);
        self.level = (self.level + per_second * (now - self.at).as_secs_f64()).min(full);
        self.at = now;
        if self.level >= 1.0 {
            self.level -= 1.0;
            return Ok(());
        }
        Err(Duration::from_secs_f64((1.0 - self.level) / per_second))
    }
}

impl Access {
    /// For these endpoints.
    pub fn new(scopes: Scopes) -> Self {
        Self {
            known: Mutex::default(),
            scopes,
        }
    }

    /// The scope that a route needs; pages need to be read.
    fn needed(&self, method: &str, path: Option<&str>) -> Option<Scope> {
        let Some(path) = path else { return Some(Scope::Read) };
        if path.starts_with("/assets/") || path == "/healthz" || path == "/readyz" {
            return None;
        }
        let entry = |method: &str| {
            self.scopes
                .iter()
                .find(|((known, at), _)| *known == method && at == path)
        };
        // Whoever may get something may ask for its headers.
        let found = entry(method).or_else(|| entry("GET").filter(|_| method == "HEAD"));
        found.map_or(Some(Scope::Read), |(_, scope)| *scope)
    }

    async fn look_up(&self, service: &Service, text: &str) -> Result<Token, ApiError> {
        let hash = token_hash(text);
        let now = Instant::now();
        let believed = {
            let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
            known
                .get(&hash)
                .filter(|known| now - known.read_at < BELIEVED)
                .map(|known| known.token.clone())
        };
        let token = match believed {
            Some(token) => Some(token),
            None => service.store.token(text).await?,
        };
        let Some(token) = token.filter(|token| token.is_live(Timestamp::now())) else {
            return Err(unauthorised("the token is unknown, expired or revoked"));
        };
        self.spend(hash, &token, now)?;
        Ok(token)
    }

    fn spend(&self, hash: [u8; 32], token: &Token, now: Instant) -> Result<(), ApiError> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if known.len() > MAX_REMEMBERED {
            known.retain(|_, known| now - known.read_at < Duration::from_secs(60));
        }
        let entry = known.entry(hash).or_insert_with(|| Known {
            token: token.clone(),
            read_at: now,
            bucket: Bucket {
                level: f64::INFINITY,
                at: now,
            },
        });
        if now - entry.read_at >= BELIEVED {
            (entry.token, entry.read_at) = (token.clone(), now);
        }
        let Some(rate) = token.rate_per_minute else {
            return Ok(());
        };
        entry.bucket.take(rate, now).map_err(|wait| {
            let detail = format!("this token may send {rate} requests a minute, and those of ten seconds at once");
            ApiError::new(StatusCode::TOO_MANY_REQUESTS, "rate_limited", detail).retry_after(wait)
        })
    }
}

fn unauthorised(detail: &str) -> ApiError {
    ApiError::new(StatusCode::UNAUTHORIZED, "unauthorised", detail)
}

/// The token's text in a request, if there is one.
fn presented(headers: &HeaderMap) -> Result<Option<String>, ApiError> {
    let Some(value) = headers.get(header::AUTHORIZATION) else {
        return Ok(None);
    };
    let malformed = || unauthorised("the header `authorization` must be `Bearer TOKEN`");
    let (scheme, rest) = value
        .to_str()
        .ok()
        .and_then(|text| text.split_once(' '))
        .ok_or_else(malformed)?;
    if scheme.eq_ignore_ascii_case("bearer") {
        return Ok(Some(rest.trim().to_owned()));
    }
    if scheme.eq_ignore_ascii_case("basic") {
        let pair = decode_base64(rest.trim()).ok_or_else(malformed)?;
        let (_, password) = pair.split_once(':').ok_or_else(malformed)?;
        return Ok(Some(password.to_owned()));
    }
    Err(malformed())
}

/// Base64 of text, as `Basic` has it.
fn decode_base64(text: &str) -> Option<String> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(text).ok()?;
    String::from_utf8(bytes).ok()
}

/// Whether a `host` header names this machine. A page elsewhere whose name was pointed at 127.0.0.1 would otherwise speak to
/// an open service as if it were ours.
fn names_this_machine(host: &str) -> bool {
    let name = match host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((name, _)) => name,
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    };
    let name = name.trim_end_matches('.');
    name.eq_ignore_ascii_case("localhost")
        || name.to_ascii_lowercase().ends_with(".localhost")
        || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Lets a request through or refuses it; handlers find the [`Caller`].
pub async fn control(State(service): State<Arc<Service>>, request: Request<Body>, next: Next) -> Response {
    let (mut parts, body) = request.into_parts();
    match admit(&service, &parts).await {
        Ok(caller) => {
            parts.extensions.insert(caller);
            next.run(Request::from_parts(parts, body)).await
        }
        Err(error) => {
            let is_unauthorised = error.status() == StatusCode::UNAUTHORIZED;
            let mut response = error.into_response();
            if is_unauthorised {
                for scheme in [
                    "Bearer realm=\"afterimage\"",
                    "Basic realm=\"afterimage: any name, a token as password\"",
                ] {
                    response
                        .headers_mut()
                        .append(header::WWW_AUTHENTICATE, axum::http::HeaderValue::from_static(scheme));
                }
            }
            response
        }
    }
}

async fn admit(service: &Service, request: &Parts) -> Result<Caller, ApiError> {
    let path = request.extensions.get::<MatchedPath>().map(MatchedPath::as_str);
    let needed = service.access.needed(request.method.as_str(), path);
    let is_open = !service.config.asks_for_tokens();
    if is_open && service.config.listen.ip().is_loopback() && !service.config.insecure {
        let host = request.headers.get(header::HOST).and_then(|host| host.to_str().ok());
        let host = host.or_else(|| request.uri.host()).unwrap_or("localhost");
        if !names_this_machine(host) {
            let detail = "without tokens the service answers only as localhost; behind a proxy use --require-tokens";
            return Err(ApiError::new(StatusCode::MISDIRECTED_REQUEST, "wrong_host", detail));
        }
    }
    let nobody = Caller {
        token_id: 0,
        name: None,
    };
    let Some(text) = presented(&request.headers)? else {
        return match needed {
            Some(scope) if !is_open => Err(unauthorised(&format!("this needs a token with the scope `{scope}`"))),
            _ => Ok(nobody),
        };
    };
    let token = service.access.look_up(service, &text).await?;
    if let Some(scope) = needed.filter(|scope| !token.allows(*scope)) {
        let detail = format!("the token `{}` does not have the scope `{scope}`", token.name);
        return Err(ApiError::new(StatusCode::FORBIDDEN, "forbidden", detail));
    }
    Ok(Caller {
        token_id: token.id,
        name: Some(token.name),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_allow_a_burst_and_then_the_rate() {
        let start = Instant::now();
        let mut bucket = Bucket {
            level: f64::INFINITY,
            at: start,
        };
        for _ in 0..10 {
            bucket.take(60, start).unwrap();
        }
        let wait = bucket.take(60, start).unwrap_err();
        assert!((0.9..=1.0).contains(&wait.as_secs_f64()), "{wait:?}");
        bucket.take(60, start + Duration::from_secs(1)).unwrap();
        bucket.take(60, start + Duration::from_secs(1)).unwrap_err();
    }

    #[test]
    fn basic_carries_a_token_as_password() {
        assert_eq!(decode_base64("YW55OmFmdF8wMQ==").as_deref(), Some("any:aft_01"));
        assert_eq!(decode_base64("YW55!"), None);
    }

    #[test]
    fn only_this_machines_names_are_its_own() {
        for (host, is_own) in [
            ("localhost:8080", true),
            ("127.0.0.1", true),
            ("[::1]:8080", true),
            ("dashboard.localhost", true),
            ("evil.example:8080", false),
            ("localhost.evil.example", false),
            ("192.168.0.7:8080", false),
        ] {
            assert_eq!(names_this_machine(host), is_own, "{host}");
        }
    }
}
