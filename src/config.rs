//! What `afterimage serve` can be told, by flags or by environment: one field, one doc line, one unit; validated once.

use std::{net::SocketAddr, path::PathBuf};

/// Settings of the service.
#[derive(Clone, Debug, clap::Args)]
pub struct Config {
    /// Address and port to listen on.
    #[arg(
        long,
        env = "AFTERIMAGE_LISTEN",
        default_value = "127.0.0.1:8080",
        value_name = "ADDRESS:PORT"
    )]
    pub listen: SocketAddr,
    /// Folder for everything the service keeps: database, sequences, images. Made if missing.
    #[arg(long, env = "AFTERIMAGE_DATA", default_value = "data", value_name = "DIR")]
    pub data: PathBuf,
    /// GPU adapter, by its number or a part of its name [default: the first one with a driver].
    #[arg(long, env = "AFTERIMAGE_ADAPTER", value_name = "NAME")]
    pub adapter: Option<String>,
    /// Largest archive that may be put as a sequence, MiB.
    #[arg(long, env = "AFTERIMAGE_MAX_ARCHIVE_MIB", default_value_t = 4096, value_name = "MIB")]
    pub max_archive_mib: u64,
    /// Largest sequence an archive may unpack to, MiB.
    #[arg(
        long,
        env = "AFTERIMAGE_MAX_SEQUENCE_MIB",
        default_value_t = 16_384,
        value_name = "MIB"
    )]
    pub max_sequence_mib: u64,
    /// Largest JSON body, KiB.
    #[arg(long, env = "AFTERIMAGE_MAX_JSON_KIB", default_value_t = 1024, value_name = "KIB")]
    pub max_json_kib: usize,
    /// How this machine's clocks are held, such as `locked 1410 MHz`; times compare only where it is equal.
    #[arg(long, env = "AFTERIMAGE_CLOCKS", default_value = "", value_name = "TEXT")]
    pub clocks: String,
    /// Ask for a token on this machine too, as behind a proxy. On other addresses one is always asked for.
    #[arg(long, env = "AFTERIMAGE_REQUIRE_TOKENS")]
    pub require_tokens: bool,
    /// Jobs that may wait; beyond, the service says that it is busy.
    #[arg(long, env = "AFTERIMAGE_MAX_QUEUED_JOBS", default_value_t = 1000, value_name = "N")]
    pub max_queued_jobs: u64,
    /// Let webhooks go to addresses of this machine and of private networks.
    #[arg(long, env = "AFTERIMAGE_PRIVATE_WEBHOOKS")]
    pub private_webhooks: bool,
    /// Listen on an address that other machines can reach without asking for tokens: anyone there may submit and delete.
    #[arg(long, env = "AFTERIMAGE_INSECURE")]
    pub insecure: bool,
}

/// A setting that cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Open to the network without anyone who could prove to be allowed.
    #[error(
        "--listen {0}: other machines can reach this address and there is no token yet; make one with `afterimage token \
         create`, or listen on 127.0.0.1, or pass --insecure to let anyone submit and delete"
    )]
    Exposed(SocketAddr),
    /// Said both ways.
    #[error("--require-tokens and --insecure contradict each other; pass one of them")]
    Contradiction,
    /// A limit that lets nothing through.
    #[error("--{0} must be at least 1")]
    ZeroLimit(&'static str),
}

impl Config {
    /// Whether requests need a token.
    pub fn asks_for_tokens(&self) -> bool {
        self.require_tokens || !self.listen.ip().is_loopback() && !self.insecure
    }

    /// Checks what clap cannot.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if self.require_tokens && self.insecure {
            return Err(ConfigError::Contradiction);
        }
        let limits = [
            ("max-archive-mib", self.max_archive_mib),
            ("max-sequence-mib", self.max_sequence_mib),
            ("max-json-kib", self.max_json_kib as u64),
            ("max-queued-jobs", self.max_queued_jobs),
        ];
        match limits.iter().find(|(_, limit)| *limit == 0) {
            Some((name, _)) => Err(ConfigError::ZeroLimit(name)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        config: Config,
    }

    fn config(arguments: &[&str]) -> Config {
        Command::parse_from([&["serve"], arguments].concat()).config
    }

    #[test]
    fn tokens_are_asked_for_where_others_can_reach() {
        for (arguments, asks) in [
            (&[][..], false),
            (&["--listen", "[::1]:0"], false),
            (&["--require-tokens"], true),
            (&["--listen", "0.0.0.0:8080"], true),
            (&["--listen", "0.0.0.0:8080", "--insecure"], false),
        ] {
            assert_eq!(config(arguments).asks_for_tokens(), asks, "{arguments:?}");
        }
        let error = config(&["--require-tokens", "--insecure"]).validate().unwrap_err();
        assert!(error.to_string().contains("contradict"), "{error}");
    }

    #[test]
    fn a_limit_of_nothing_is_named() {
        let error = config(&["--max-json-kib", "0"]).validate().unwrap_err();
        assert!(error.to_string().contains("--max-json-kib"), "{error}");
    }
}
