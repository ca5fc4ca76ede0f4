//! `/sequences`: what there is to run recipes on, with a picture, its size, and what the convention check says.

use super::{
    format,
    layout::{Page, PageError, Section},
};
use crate::{
    sequence::check::Severity,
    server::Shared,
    store::{Check, Sequence, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};

/// Wide enough for a card, twice over for dense screens, in pixels.
const THUMBNAIL: u32 = 320;

/// `GET /sequences`
pub async fn page(State(service): Shared) -> Result<Html<String>, PageError> {
    let mut cards = Vec::new();
    for sequence in service.store.sequences().await? {
        let check = service.store.check(sequence.id).await?;
        let whole = service.store.sequence(&sequence.hash).await?;
        cards.push((whole.unwrap_or(sequence), check));
    }
    let content = html! {
        h1 { "Sequences" }
        @if cards.is_empty() {
            p { "There is no sequence yet. Send one:" }
            pre tabindex="0" { "tar -C my-sequence -cf - . | curl -T - http://localhost:8080/api/v1/sequences/my-sequence" }
        }
        ul.cards { @for (sequence, check) in &cards { (card(sequence, check)) } }
    };
    let page = Page {
        title: "Sequences",
        section: Some(Section::Sequences),
        script: None,
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

fn card(sequence: &Sequence, check: &Check) -> Markup {
    let middle = sequence.n_frames / 2;
    let image = if sequence.manifest["reference"].is_null() {
        "input"
    } else {
        "reference"
    };
    html! {
        li {
            a href={ "/sequences/" (sequence.hash) } {
                img loading="lazy" src={ "/api/v1/sequences/" (sequence.hash) "/frames/" (middle) "/" (image) ".png?width=" (THUMBNAIL) }
                    width=(sequence.output_size.width) height=(sequence.output_size.height) alt={ (image) " of frame " (middle) };
                b { (sequence.name) }
            }
            div.muted { (sequence.n_frames) " frames, " (sequence.render_size)
                @if sequence.output_size != sequence.render_size { " to " (sequence.output_size) }
                ", " (format::bytes(sequence.n_bytes)) }
            div { (standing(check)) }
            div.muted { "put " (format::age(sequence.put_at, Timestamp::now())) ", " (format::short_hash(&sequence.hash)) }
        }
    }
}

/// The check in a word.
fn standing(check: &Check) -> Markup {
    match check {
        Check::Pending => html! { span.mark.muted { "not checked yet" } },
        Check::Failed { error, .. } => html! { span.mark.bad title=(error) { "✗ could not be checked" } },
        Check::Done { report, .. } => {
            let warnings = report
                .findings
                .iter()
                .filter(|finding| finding.severity == Severity::Warning)
                .count();
            match warnings {
                0 => html! { span.mark.good { "✓ conventions can be true" } },
                1 => html! { span.mark.bad { "✗ 1 warning" } },
                n => html! { span.mark.bad { "✗ " (n) " warnings" } },
            }
        }
    }
}
