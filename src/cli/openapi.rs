//! `afterimage openapi`: the API's description without a service.

use super::JsonTarget;

/// Write the OpenAPI document of the REST API
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage openapi
  afterimage openapi openapi.json")]
pub struct Arguments {
    /// Where to; `-` is standard output
    #[arg(default_value = "-", value_name = "FILE")]
    target: JsonTarget,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    arguments.target.write(afterimage::server::document())?;
    Ok(true)
}
