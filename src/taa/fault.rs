//! A mistake put into a shader on purpose.

use crate::gpu::GpuError;
use std::borrow::Cow;

/// A pass whose shader says something else than it should: for tests of whatever has to notice that. Nothing that a user
/// can ask for leads here.
#[derive(Clone, Copy, Debug)]
pub struct Fault<'a> {
    /// Which pass.
    pub pass: &'a str,
    /// What its shader says, or a file it is compiled with.
    pub text: &'a str,
    /// What it says instead.
    pub instead: &'a str,
}

/// The sources of `pass` with the fault, where it is in that pass.
pub fn planted<'a>(fault: Option<Fault<'_>>, pass: &str, sources: &[&'a str]) -> Result<Vec<Cow<'a, str>>, GpuError> {
    let Some(fault) = fault.filter(|fault| fault.pass == pass) else {
        return Ok(sources.iter().map(|&source| source.into()).collect());
    };
    if !sources.iter().any(|source| source.contains(fault.text)) {
        return Err(GpuError::Pass {
            pass: pass.to_owned(),
            message: format!("says nowhere `{}`", fault.text),
        });
    }
    let altered = sources
        .iter()
        .map(|source| source.replace(fault.text, fault.instead).into());
    Ok(altered.collect())
}
