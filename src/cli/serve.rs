//! `afterimage serve`: the REST API and the dashboard.

use afterimage::{config::Config, server};

/// Serve the REST API and the dashboard until interrupted.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage serve
  afterimage serve --listen 127.0.0.1:9000 --data /var/lib/afterimage
  AFTERIMAGE_ADAPTER=llvmpipe afterimage serve

Then open http://127.0.0.1:8080/ in a browser. SIGTERM and Ctrl-C put a running job back into the queue.")]
pub struct Arguments {
    #[command(flatten)]
    config: Config,
}

pub fn run(arguments: Arguments) -> anyhow::Result<bool> {
    let runtime = tokio::runtime::Runtime::new()?;
    runtime.block_on(server::serve(arguments.config))?;
    Ok(true)
}
