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
    /// Listen on an address that other machines can reach, although anyone there may then submit and delete.
    #[arg(long, env = "AFTERIMAGE_INSECURE")]
    pub insecure: bool,
}

/// A setting that cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Open to the network without authentication.
    #[error(
        "--listen {0}: other machines can reach this address and there is no authentication yet, so anyone could submit \
         jobs; listen on 127.0.0.1 (and reach it through a proxy or an SSH tunnel), or pass --insecure"
    )]
    Exposed(SocketAddr),
    /// A limit that lets nothing through.
    #[error("--{0} must be at least 1")]
    ZeroLimit(&'static str),
}

impl Config {
    /// Checks what clap cannot.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if !self.listen.ip().is_loopback() && !self.insecure {
            return Err(ConfigError::Exposed(self.listen));
        }
        let limits = [
            ("max-archive-mib", self.max_archive_mib),
            ("max-sequence-mib", self.max_sequence_mib),
            ("max-json-kib", self.max_json_kib as u64),
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
    fn a_reachable_address_needs_to_be_asked_for() {
        assert!(config(&[]).validate().is_ok());
        assert!(config(&["--listen", "[::1]:0"]).validate().is_ok());
        let error = config(&["--listen", "0.0.0.0:8080"]).validate().unwrap_err();
        assert!(error.to_string().contains("--insecure"), "{error}");
        assert!(config(&["--listen", "0.0.0.0:8080", "--insecure"]).validate().is_ok());
    }

    #[test]
    fn a_limit_of_nothing_is_named() {
        let error = config(&["--max-json-kib", "0"]).validate().unwrap_err();
        assert!(error.to_string().contains("--max-json-kib"), "{error}");
    }
}
