//! What happens by itself: silence is noticed, and what nobody needs any more is forgotten.

use super::Service;
use crate::store::{StoreError, Timestamp};
use serde_json::json;
use std::{
    sync::Arc,
    time::{Duration, SystemTime},
};

const EVERY: Duration = Duration::from_secs(600);
/// How long answers are kept for clients that ask again, and reports for frames that do not come.
const KEPT_MS: i64 = 24 * 3_600_000;
/// How long blobs are kept that nobody touches.
const BLOBS_KEPT: Duration = Duration::from_secs(7 * 24 * 3600);

/// Tidies every ten minutes until the service stops.
pub async fn tidy(service: Arc<Service>) {
    loop {
        if let Err(error) = once(&service).await {
            tracing::error!(%error, "cannot tidy up");
        }
        tokio::select! {
            () = service.shutdown.cancelled() => return,
            () = tokio::time::sleep(EVERY) => {}
        }
    }
}

async fn once(service: &Service) -> Result<(), StoreError> {
    let now = Timestamp::now();
    service.store.forget_before(Timestamp(now.0 - KEPT_MS)).await?;
    if let Err(error) = service.folder.forget_blobs(SystemTime::now() - BLOBS_KEPT) {
        tracing::warn!(%error, "cannot remove old blobs");
    }
    for id in service.store.note_silence(now).await? {
        let filter = crate::store::AlertFilter {
            id: Some(id),
            limit: 1,
            ..crate::store::AlertFilter::default()
        };
        for alert in service.store.alerts(&filter).await? {
            tracing::warn!(alert = id, series = alert.series.id, "a line is silent");
            let payload = json!({
                "project": alert.project, "branch": alert.branch, "sequence": alert.series.sequence_name,
                "recipe": alert.series.preset, "detail": alert.detail, "alerts": [id],
            });
            if service.store.announce(&alert.project, "no_data", &payload, now).await? > 0 {
                service.deliver.notify_one();
            }
        }
    }
    Ok(())
}
