//! Telling others of verdicts. A delivery is a POST of JSON with the header `x-afterimage-signature: t=SECONDS,v1=HEX`,
//! where HEX is HMAC-SHA256, by the webhook's secret, over `SECONDS.` and the body: the time is signed too, so that an old
//! delivery cannot be played again. What is not answered with 2xx is tried again for a day.
//!
//! A webhook's address is chosen by a user and followed by this machine, so it may not lead to what only this machine
//! reaches: addresses are checked where they are resolved, at each attempt, and redirects are not followed.

use super::Service;
use crate::{
    hex::hex,
    store::{Delivery, Timestamp},
};
use hmac::{Hmac, Mac as _};
use sha2::Sha256;
use std::{
    collections::BTreeSet,
    net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs as _},
    sync::Arc,
    time::Duration,
};
use tokio::{sync::oneshot, task::JoinSet};
use ureq::{
    http::Uri,
    unversioned::{
        resolver::{ResolvedSocketAddrs, Resolver},
        transport::{DefaultConnector, NextTimeout},
    },
};

/// An attempt takes no longer.
const TIMEOUT: Duration = Duration::from_secs(10);
/// How often the queue is looked at without being told.
const IDLE: Duration = Duration::from_secs(5);
/// Attempts at once.
const MAX_UNDER_WAY: usize = 16;
/// What is under way when the service stops has this long to end.
const LAST: Duration = Duration::from_secs(2);

/// Why an address will not do.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// Not an address, or not for HTTP.
    #[error("the address must be `https://HOST/…` or `http://HOST/…`, without user name")]
    Form,
    /// No such name.
    #[error("the name `{0}` cannot be resolved")]
    Unresolved(String),
    /// Within this machine or its network.
    #[error("`{0}` leads to {1}, which is not a public address (--private-webhooks allows it)")]
    Private(String, IpAddr),
}

/// Where a delivery goes.
#[derive(Clone, Debug)]
pub struct Target {
    host: String,
    port: u16,
    allows_private: bool,
}

impl Target {
    /// Checks the form of an address.
    pub fn parse(url: &str, allows_private: bool) -> Result<Self, TargetError> {
        let uri: Uri = url.parse().map_err(|_| TargetError::Form)?;
        let default_port = match uri.scheme_str() {
            Some("https") => 443,
            Some("http") => 80,
            _ => return Err(TargetError::Form),
        };
        let authority = uri
            .authority()
            .filter(|authority| !authority.as_str().contains('@'))
            .ok_or(TargetError::Form)?;
        let host = authority.host().trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() {
            return Err(TargetError::Form);
        }
        let port = match authority.as_str() == authority.host() {
            true => default_port,
            false => authority
                .port_u16()
                .filter(|port| *port != 0)
                .ok_or(TargetError::Form)?,
        };
        Ok(Self {
            host: host.to_owned(),
            port,
            allows_private,
        })
    }

    /// Resolves the name; every address must do, because any of them may be used.
    pub fn addresses(&self) -> Result<Vec<SocketAddr>, TargetError> {
        let found = (self.host.as_str(), self.port).to_socket_addrs();
        let found: Vec<_> = found.map_err(|_| TargetError::Unresolved(self.host.clone()))?.collect();
        let bad = found
            .iter()
            .find(|address| !self.allows_private && !is_public(address.ip()));
        match (bad, found.is_empty()) {
            (Some(bad), _) => Err(TargetError::Private(self.host.clone(), bad.ip())),
            (None, true) => Err(TargetError::Unresolved(self.host.clone())),
            (None, false) => Ok(found),
        }
    }
}

/// Whether an address is on the internet at large.
fn is_public(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(address) => is_public_v4(address),
        IpAddr::V6(address) => {
            if let Some(mapped) = address.to_ipv4_mapped() {
                return is_public_v4(mapped);
            }
            let first = address.segments()[0];
            // 2000::/3 is what is routed, without 6to4, Teredo and documentation, which lead elsewhere or nowhere.
            first & 0xe000 == 0x2000
                && first != 0x2002
                && !(first == 0x2001 && matches!(address.segments()[1], 0 | 0x0db8))
        }
    }
}

fn is_public_v4(address: Ipv4Addr) -> bool {
    let [a, b, c, _] = address.octets();
    let is_special = address.is_private()
        || address.is_loopback()
        || address.is_link_local()
        || address.is_broadcast()
        || address.is_documentation()
        || address.is_multicast()
        || matches!(
            (a, b, c),
            (0, ..) | (240.., ..) | (100, 64..=127, _) | (192, 0, 0) | (198, 18 | 19, _)
        );
    !is_special
}

/// Resolves by [`Target::addresses`], whatever the name said a moment ago.
#[derive(Debug)]
struct Checked {
    allows_private: bool,
}

impl Resolver for Checked {
    fn resolve(&self, uri: &Uri, _: &ureq::config::Config, _: NextTimeout) -> Result<ResolvedSocketAddrs, ureq::Error> {
        let target =
            Target::parse(&uri.to_string(), self.allows_private).map_err(|error| ureq::Error::Other(error.into()))?;
        let addresses = target.addresses().map_err(|error| ureq::Error::Other(error.into()))?;
        let mut resolved = self.empty();
        addresses
            .into_iter()
            .take(16)
            .for_each(|address| resolved.push(address));
        Ok(resolved)
    }
}

/// What proves that a delivery is ours.
fn signature(secret: &str, seconds: u64, body: &str) -> String {
    let mut mac = Hmac::<Sha256>::new_from_slice(secret.as_bytes()).expect("HMAC takes keys of any length");
    mac.update(format!("{seconds}.{body}").as_bytes());
    format!("t={seconds},v1={}", hex(&mac.finalize().into_bytes()))
}

fn send(delivery: &Delivery, allows_private: bool) -> Result<(), String> {
    let config = ureq::Agent::config_builder()
        .timeout_global(Some(TIMEOUT))
        .max_redirects(0)
        .http_status_as_error(false)
        .proxy(None)
        .build();
    let agent = ureq::Agent::with_parts(config, DefaultConnector::default(), Checked { allows_private });
    let seconds = (Timestamp::now().0 / 1000).max(0) as u64;
    let answer = agent
        .post(&delivery.url)
        .header("content-type", "application/json")
        .header("user-agent", concat!("afterimage/", env!("CARGO_PKG_VERSION")))
        .header("x-afterimage-event", &delivery.event)
        .header("x-afterimage-delivery", delivery.id.to_string())
        .header(
            "x-afterimage-signature",
            signature(&delivery.secret, seconds, &delivery.payload),
        )
        .send(&delivery.payload);
    match answer {
        Ok(answer) if answer.status().is_success() => Ok(()),
        Ok(answer) => Err(format!("answered {}", answer.status())),
        Err(error) => Err(error.to_string()),
    }
}

/// Sends what is due until the service stops: one delivery a webhook at a time, so that one that does not answer keeps only its
/// own waiting. What is under way at the stop may be sent again at the next start.
pub async fn deliver(service: Arc<Service>) {
    let mut under_way = JoinSet::new();
    let mut busy = BTreeSet::new();
    loop {
        let due = service
            .store
            .due_deliveries(Timestamp::now(), &busy, MAX_UNDER_WAY - busy.len())
            .await
            .unwrap_or_else(|error| {
                tracing::error!(%error, "cannot read what is to be delivered");
                Vec::new()
            });
        for delivery in due {
            busy.insert(delivery.webhook_id);
            under_way.spawn(attempt(Arc::clone(&service), delivery));
        }
        tokio::select! {
            () = service.shutdown.cancelled() => break,
            Some(done) = under_way.join_next() => match done {
                Ok(webhook) => drop(busy.remove(&webhook)),
                Err(error) => return tracing::error!(%error, "deliveries have ended"),
            },
            () = service.deliver.notified() => {}
            () = tokio::time::sleep(IDLE) => {}
        }
    }
    let _ = tokio::time::timeout(LAST, under_way.join_all()).await;
}

/// Makes an attempt and notes how it ended; gives the webhook.
async fn attempt(service: Arc<Service>, delivery: Delivery) -> i64 {
    let allows_private = service.config.private_webhooks;
    let (sender, result) = oneshot::channel();
    let sent = delivery.clone();
    // A thread of its own: those of the runtime would be waited for at the end.
    let thread = std::thread::Builder::new().name("webhook".to_owned());
    let started = thread.spawn(move || sender.send(send(&sent, allows_private)));
    let result = match started {
        Ok(_) => result.await.unwrap_or_else(|_| Err("the attempt broke off".to_owned())),
        Err(error) => Err(error.to_string()),
    };
    if let Err(error) = &result {
        tracing::warn!(delivery = delivery.id, error, "a webhook did not take its delivery");
    }
    let noted = service
        .store
        .note_delivery(&delivery, result.err().as_deref(), Timestamp::now())
        .await;
    if let Err(error) = noted {
        tracing::error!(%error, "cannot note a delivery");
        // It is due still, and would be sent again at once.
        tokio::time::sleep(IDLE).await;
    }
    delivery.webhook_id
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_public_addresses_are_followed() {
        for (url, is_good) in [
            ("https://93.184.216.34/hook", true),
            ("http://[2606:2800:220:1:248:1893:25c8:1946]:8080/", true),
            ("http://127.0.0.1:9/", false),
            ("http://0.0.0.0/", false),
            ("http://10.1.2.3/", false),
            ("http://169.254.169.254/latest/meta-data", false),
            ("http://100.64.0.1/", false),
            ("http://[::1]/", false),
            ("http://[::ffff:127.0.0.1]/", false),
            ("http://[fd00::1]/", false),
            ("http://[2002:7f00:1::]/", false),
            ("https://93.184.216.34:8443/hook", true),
            ("https://93.184.216.34:99999/", false),
            ("https://93.184.216.34:/", false),
            ("https://93.184.216.34:0/", false),
            ("ftp://93.184.216.34/", false),
            ("https://user@93.184.216.34/", false),
            ("/only/a/path", false),
        ] {
            let checked = Target::parse(url, false).and_then(|target| target.addresses());
            assert_eq!(checked.is_ok(), is_good, "{url}: {checked:?}");
        }
        assert!(Target::parse("http://127.0.0.1:9/", true).unwrap().addresses().is_ok());
    }

    #[test]
    fn signatures_are_hmac_sha256() {
        // Computed with the hmac module of Python.
        let expected = "t=1700000000,v1=5229bfb26a3ed151747290d0e5ce518928ac9391cb7c54359568c48550b3d93c";
        assert_eq!(signature("whs_test", 1_700_000_000, "{\"a\":1}"), expected);
    }
}
