//! `afterimage token`: makes, lists and revokes access tokens, in the data folder itself. Whoever may write there may make
//! tokens; the service may run meanwhile.

use super::{print, table};
use afterimage::store::{NewToken, Scope, Store, Timestamp};
use anyhow::Context;
use std::{path::PathBuf, time::Duration};

/// Make, list or revoke access tokens
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage token create nightly --scopes read,submit --expires-days 90
  afterimage token create reviewers --scopes read,approve --rate 600
  afterimage token list
  afterimage token revoke 3

A token is shown once, when it is made. Scopes: read, submit (sequences, jobs, results), approve (baselines, alerts),
admin (all of it, tokens and webhooks).")]
pub struct Arguments {
    /// The service's data folder
    #[arg(
        long,
        env = "AFTERIMAGE_DATA",
        default_value = "data",
        value_name = "DIR",
        global = true
    )]
    data: PathBuf,
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Subcommand)]
enum Action {
    /// Make a token and show it, this once
    Create {
        /// For people: what it is for
        name: String,
        /// What it allows, separated by commas: read, submit, approve, admin
        #[arg(long, value_delimiter = ',', default_value = "read,submit", value_name = "SCOPES")]
        scopes: Vec<Scope>,
        /// Ends after so many days [default: never]
        #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u32).range(1..=36_500))]
        expires_days: Option<u32>,
        /// Requests a minute [default: no limit]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        rate: Option<u32>,
    },
    /// Show all tokens, without their text
    List,
    /// End a token; a running service notices within 2 s
    Revoke {
        /// Its number
        id: i64,
    },
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(act(arguments))
}

async fn act(arguments: &Arguments) -> anyhow::Result<bool> {
    let data = &arguments.data;
    let database = data.join("afterimage.sqlite");
    match arguments.action {
        Action::Create { .. } => {
            std::fs::create_dir_all(data).with_context(|| format!("--data {}", data.display()))?;
        }
        Action::List | Action::Revoke { .. } => {
            anyhow::ensure!(
                database.is_file(),
                "--data {}: no service has its data there",
                data.display()
            );
        }
    }
    let store = Store::open(&database).await?;
    let now = Timestamp::now();
    match &arguments.action {
        Action::Create {
            name,
            scopes,
            expires_days,
            rate,
        } => {
            anyhow::ensure!(
                (1..=100).contains(&name.trim().len()),
                "give the token a name of 1 to 100 bytes"
            );
            let new = NewToken {
                name: name.trim().to_owned(),
                scopes: scopes.iter().copied().collect(),
                rate_per_minute: *rate,
                expires_at: expires_days.map(|days| now + Duration::from_secs(u64::from(days) * 86_400)),
            };
            let (text, token) = store.create_token(&new, now).await?;
            super::note(&format!("token {} ({}); it is not shown again", token.id, token.name));
            print(&format!("{text}\n"));
        }
        Action::List => print(&list(&store, now).await?),
        Action::Revoke { id } => {
            anyhow::ensure!(
                store.revoke_token(*id, now).await?,
                "there is no token {id} that is not revoked"
            );
            super::note(&format!("token {id} is revoked"));
        }
    }
    store.close().await;
    Ok(true)
}

async fn list(store: &Store, now: Timestamp) -> anyhow::Result<String> {
    let header = ["id", "name", "begins with", "scopes", "a minute", "state"];
    let mut table = table::new(header.map(str::to_owned).to_vec(), 6);
    for token in store.tokens().await? {
        let scopes: Vec<String> = token.scopes.iter().map(ToString::to_string).collect();
        let state = match (token.revoked_at, token.expires_at) {
            (Some(at), _) => format!("revoked {at}"),
            (None, Some(end)) if end <= now => format!("expired {end}"),
            (None, Some(end)) => format!("until {end}"),
            (None, None) => "live".to_owned(),
        };
        table.add_row(vec![
            token.id.to_string(),
            token.name,
            token.handle,
            scopes.join(","),
            token
                .rate_per_minute
                .map_or_else(|| "–".to_owned(), |rate| rate.to_string()),
            state,
        ]);
    }
    Ok(format!("{table}\n"))
}
