//! `afterimage serve`: the REST API and the dashboard.

use super::lavapipe;
use afterimage::{config::Config, server};
use std::thread;

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
    // A pass is dealt out to lavapipe's threads in equal parts, and ends with the last: where a request takes a core, the fewer
    // the parts, the longer the other cores wait for that one.
    let n_threads = 4 * thread::available_parallelism()?.get();
    if let Err(error) = lavapipe::with_threads(n_threads) {
        tracing::warn!(%error, "lavapipe keeps the number of its threads");
    }
    let runtime = tokio::runtime::Runtime::new()?;
    runtime.block_on(server::serve(arguments.config))?;
    Ok(true)
}
