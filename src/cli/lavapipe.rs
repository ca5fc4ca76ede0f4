//! How many threads lavapipe has.

use anyhow::Context as _;
use std::env;

/// What lavapipe reads as it is loaded.
const THREADS: &str = "LP_NUM_THREADS";

/// As [`with_threads`], with none: commands that rasterise need it. In Mesa 22.3 a thread of lavapipe's may still be unlocking
/// a fence that the thread which waited for its frame has freed by then, which corrupts memory now and then.
pub fn without_threads() -> anyhow::Result<()> {
    with_threads(0)
}

/// Begins the command anew with so many threads of lavapipe's, unless their number is given already.
pub fn with_threads(n_threads: usize) -> anyhow::Result<()> {
    #[cfg(unix)]
    if env::var_os(THREADS).is_none() {
        use std::os::unix::process::CommandExt;
        let mut anew = std::process::Command::new(env::current_exe()?);
        let failed = anew
            .args(env::args_os().skip(1))
            .env(THREADS, n_threads.to_string())
            .exec();
        return Err(failed).with_context(|| format!("cannot begin anew with {THREADS}={n_threads}"));
    }
    Ok(())
}
