//! `afterimage regressions`: what a service found wanting since a commit.

use super::{
    JsonTarget,
    client::{Client, TokenOption},
    print, table,
};
use serde_json::Value;

/// Show the alerts of a service since a commit; status 1 where any is open
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage regressions http://127.0.0.1:8080 --since $(git rev-parse v1.4^{commit})
  afterimage regressions http://127.0.0.1:8080 --branch main --json -

Exit status: 0 none is open, 1 some are, 2 wrong use or no answer.")]
pub struct Arguments {
    /// Address of the service
    #[arg(env = "AFTERIMAGE_SERVER")]
    url: String,
    #[command(flatten)]
    token: TokenOption,
    /// Only alerts whose first bad report is of this commit, or came after it
    #[arg(long, value_name = "COMMIT")]
    since: Option<String>,
    /// Only of this project
    #[arg(long, value_name = "NAME")]
    project: Option<String>,
    /// Only of this branch
    #[arg(long, value_name = "NAME")]
    branch: Option<String>,
    /// Closed ones too
    #[arg(long)]
    all: bool,
    /// Write the alerts as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    json: Option<JsonTarget>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let client = Client::new(&arguments.url, &arguments.token);
    let alerts = alerts(&client, arguments)?;
    if let Some(target) = &arguments.json {
        target.write(&alerts)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        print(&show(&alerts, &client.url));
    }
    Ok(alerts.iter().all(|alert| alert["status"] != "open"))
}

fn alerts(client: &Client, arguments: &Arguments) -> anyhow::Result<Vec<Value>> {
    let mut query = String::from("alerts?limit=1000");
    let status = (!arguments.all).then(|| "open".to_owned());
    for (name, value) in [
        ("status", &status),
        ("since", &arguments.since),
        ("project", &arguments.project),
        ("branch", &arguments.branch),
    ] {
        if let Some(value) = value {
            query += &format!("&{name}={}", super::percent_encoded(value));
        }
    }
    let mut alerts = Vec::new();
    let mut cursor = String::new();
    loop {
        let page = client.get(&format!("{query}{cursor}"))?;
        alerts.extend(page["alerts"].as_array().cloned().unwrap_or_default());
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return Ok(alerts),
        }
    }
}

fn show(alerts: &[Value], url: &str) -> String {
    if alerts.is_empty() {
        return "no alerts\n".to_owned();
    }
    let header = [
        "alert",
        "status",
        "branch",
        "sequence",
        "recipe",
        "metric",
        "first bad",
        "last good",
        "what",
    ];
    let mut table = table::new(header.map(str::to_owned).to_vec(), 9);
    for alert in alerts {
        let text = |value: &Value| value.as_str().unwrap_or("–").chars().take(120).collect::<String>();
        let commit = |value: &Value| value.as_str().unwrap_or("–").chars().take(10).collect::<String>();
        table.add_row(vec![
            alert["id"].to_string(),
            text(&alert["status"]),
            text(&alert["branch"]),
            text(&alert["series"]["sequence_name"]),
            text(&alert["series"]["preset"]),
            text(&alert["metric"]),
            commit(&alert["finding"]["first_bad_commit"]),
            commit(&alert["finding"]["last_good_commit"]),
            text(&alert["detail"]),
        ]);
    }
    format!("{table}\n{url}/alerts\n")
}
