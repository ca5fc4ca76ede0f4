# Builds the service with its decode worker, and runs it on lavapipe as an ordinary user.
FROM rust:1.95-slim-bookworm AS build
WORKDIR /build
RUN apt-get update \
    && apt-get install -y --no-install-recommends build-essential pkg-config libopenimageio-dev libopenexr-dev git \
    && rm -rf /var/lib/apt/lists/*
COPY . .
RUN cargo build --locked --release --package afterimage --package oiio-decoder

FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers libopenimageio2.4 curl \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --create-home --home-dir /data afterimage
COPY --from=build /build/target/release/afterimage /build/target/release/afterimage-oiio-decoder /usr/local/bin/
USER afterimage
VOLUME /data
EXPOSE 8080
# Compiled shaders outlive the container beside the data.
ENV AFTERIMAGE_LISTEN=0.0.0.0:8080 \
    AFTERIMAGE_DATA=/data \
    AFTERIMAGE_INSECURE=true \
    MESA_SHADER_CACHE_DIR=/data/shader-cache \
    NODEVICE_SELECT=1
HEALTHCHECK --interval=30s --timeout=5s --start-period=10s CMD curl --fail --silent --output /dev/null http://127.0.0.1:8080/api/v1/health
CMD ["afterimage", "serve"]
