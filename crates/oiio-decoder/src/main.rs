//! Decode worker of afterimage: reads image files through OpenImageIO in a process of its own, so that what a decoder
//! costs at start, leaks or breaks stays here. Speaks `protocol.rs` on standard input and output; never run by hand.

mod decode;
mod oiio;
#[path = "../../../src/image/files/protocol.rs"]
mod protocol;

use decode::Decoder;
use protocol::{Reply, Request, Settings};
use rustix::process::{Resource, Rlimit, Signal, getpid, kill_process, setrlimit};
use std::io::{self, BufRead as _, Write as _};
use std::process::ExitCode;
use std::sync::mpsc::channel;
use std::thread;

fn main() -> ExitCode {
    match start() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Nobody may be listening, and there is nowhere else to say it.
            let _ = writeln!(io::stderr(), "afterimage-oiio-decoder: {error}");
            ExitCode::from(2)
        }
    }
}

fn start() -> Result<(), Box<dyn std::error::Error>> {
    let argument = std::env::args().nth(1).ok_or("is started by afterimage, not by hand")?;
    let settings: Settings = serde_json::from_str(&argument)?;
    let limit = Some(settings.memory_bytes);
    setrlimit(
        Resource::As,
        Rlimit {
            current: limit,
            maximum: limit,
        },
    )?;
    // A crash on a stranger's file is expected; gigabytes of core file for each are not.
    setrlimit(
        Resource::Core,
        Rlimit {
            current: Some(0),
            maximum: Some(0),
        },
    )?;

    let (sender, requests) = channel::<String>();
    let pixels = std::fs::File::options().read(true).write(true).open(&settings.pixels)?;
    thread::spawn(move || {
        let mut decoder = Decoder::new(&settings, pixels);
        let said = say(&Reply::Ready).and_then(|()| {
            requests.iter().try_for_each(|line| {
                let reply = match serde_json::from_str::<Request>(&line) {
                    Ok(request) => decoder.answer(&request),
                    Err(error) => Reply::Error(format!("the request is of another version: {error}")),
                };
                say(&reply)
            })
        });
        // Only the parent reads the output: when that fails, it is gone.
        if said.is_err() {
            end();
        }
    });
    for line in io::stdin().lock().lines() {
        sender.send(line?)?;
    }
    end();
    Ok(())
}

fn say(reply: &Reply) -> io::Result<()> {
    let mut line = serde_json::to_string(reply)?;
    line.push('\n');
    io::stdout().lock().write_all(line.as_bytes())
}

/// The parent is gone. Ends at once, even in the middle of a decode, and without the libraries' destructors, which
/// would run beside it.
fn end() {
    // Cannot fail for the process itself.
    let _ = kill_process(getpid(), Signal::KILL);
}
