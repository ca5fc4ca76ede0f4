//! Tokens and webhooks. Tokens are made on the command line only, by whoever may read the data folder.

use super::{ApiError, ApiPath, Shared, blocking, extract::ApiJson, origin::check_name, webhooks::Target};
use crate::store::{DEFAULT_PROJECT, DeliveryStatus, Timestamp, Token, Webhook, random_secret};
use axum::{
    Json,
    extract::State,
    http::{StatusCode, header},
    response::IntoResponse,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Every token.
#[derive(Serialize, JsonSchema)]
pub struct TokenList {
    /// Without anything that would let someone use them.
    tokens: Vec<Token>,
}

/// `GET /tokens`
pub async fn tokens(State(service): Shared) -> Result<Json<TokenList>, ApiError> {
    let tokens = service.store.tokens().await?;
    Ok(Json(TokenList { tokens }))
}

/// `DELETE /tokens/{token}`
pub async fn revoke(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<StatusCode, ApiError> {
    match service.store.revoke_token(id, Timestamp::now()).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(ApiError::not_found(format!(
            "there is no token {id} that is not revoked"
        ))),
    }
}

/// Every webhook.
#[derive(Serialize, JsonSchema)]
pub struct WebhookList {
    /// Without their secrets.
    webhooks: Vec<Webhook>,
}

/// `GET /webhooks`
pub async fn webhooks(State(service): Shared) -> Result<Json<WebhookList>, ApiError> {
    let webhooks = service.store.webhooks().await?;
    Ok(Json(WebhookList { webhooks }))
}

/// The body of `POST /webhooks`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookRequest {
    /// Where to: `https://…`, or `http://…`.
    #[schemars(length(min = 8, max = 2000), url)]
    url: String,
    /// Whose verdicts; `default` where left out.
    #[serde(default)]
    #[schemars(length(min = 1, max = 100))]
    project: Option<String>,
}

/// A new webhook with its secret, which is shown this once.
#[derive(Serialize, JsonSchema)]
pub struct NewWebhook {
    /// The webhook.
    #[serde(flatten)]
    webhook: Webhook,
    /// Signs every delivery.
    secret: String,
}

/// `POST /webhooks`
pub async fn create_webhook(
    State(service): Shared,
    ApiJson(request): ApiJson<WebhookRequest>,
) -> Result<impl IntoResponse, ApiError> {
    let project = request.project.unwrap_or_else(|| DEFAULT_PROJECT.to_owned());
    check_name("project", &project)?;
    let allows_private = service.config.private_webhooks;
    let url = request.url.clone();
    // Resolving a name may take a while.
    blocking(move || Target::parse(&url, allows_private).and_then(|target| target.addresses()))
        .await?
        .map_err(|error| ApiError::invalid("invalid_url", error.to_string()).field("url"))?;
    let secret = random_secret("whs_")?;
    let webhook = service
        .store
        .create_webhook(&project, &request.url, &secret, Timestamp::now())
        .await?;
    let location = [(header::LOCATION, format!("/api/v1/webhooks/{}", webhook.id))];
    Ok((StatusCode::CREATED, location, Json(NewWebhook { webhook, secret })))
}

/// `DELETE /webhooks/{webhook}`
pub async fn delete_webhook(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<StatusCode, ApiError> {
    match service.store.delete_webhook(id).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(ApiError::not_found(format!("there is no webhook {id}"))),
    }
}

/// The last deliveries of a webhook.
#[derive(Serialize, JsonSchema)]
pub struct DeliveryList {
    /// Newest first, at most 100.
    deliveries: Vec<DeliveryStatus>,
}

/// `GET /webhooks/{webhook}/deliveries`
pub async fn deliveries(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Json<DeliveryList>, ApiError> {
    if !service.store.webhooks().await?.iter().any(|webhook| webhook.id == id) {
        return Err(ApiError::not_found(format!("there is no webhook {id}")));
    }
    let deliveries = service.store.deliveries(id).await?;
    Ok(Json(DeliveryList { deliveries }))
}
