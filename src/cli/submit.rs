//! stub
#[derive(clap::Args)]
pub struct Arguments {}
pub fn run(_a: &Arguments) -> anyhow::Result<bool> {
    Ok(true)
}
