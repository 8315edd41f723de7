# syntax=docker/dockerfile:1
# Build: docker build -t pinstack .        Run: docker compose -f deploy/compose.yaml up

FROM rust:1.95-slim-bookworm AS build
WORKDIR /src
COPY . .
# The registry and the compiled dependencies are cached between builds.
RUN --mount=type=cache,target=/usr/local/cargo/registry --mount=type=cache,target=/src/target \
    cargo build --release --locked --bin pinstack && cp target/release/pinstack /usr/local/bin/pinstack

FROM debian:bookworm-slim
# A fixed user id, so that a mounted folder can be owned by it: chown 10001 /srv/pinstack
RUN useradd --uid 10001 --user-group --no-create-home --shell /usr/sbin/nologin pinstack \
    && install -d -o pinstack -g pinstack /data
COPY --from=build /usr/local/bin/pinstack /usr/local/bin/pinstack
# In a container other machines may reach every address: without a token (pinstack token add, on /data) or PINSTACK_AUTH=none
# the server refuses to start, with a message.
USER 10001:10001
ENV PINSTACK_LISTEN=0.0.0.0:8080 PINSTACK_DATA_DIR=/data
VOLUME /data
EXPOSE 8080
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=15s --timeout=5s --start-period=10s --retries=3 CMD ["pinstack", "health"]
ENTRYPOINT ["pinstack"]
CMD ["serve"]
