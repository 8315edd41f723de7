# Build: docker build -t pinstack .        Run: docker compose -f deploy/compose.yaml up
#
# Needs no BuildKit: docker, podman and buildah build it. scripts/release/image.sh builds it with version and revision.

ARG RUST_IMAGE=docker.io/library/rust:1.95-slim-bookworm

FROM ${RUST_IMAGE} AS build
WORKDIR /src
# for the licences
RUN apt-get update && apt-get install -y --no-install-recommends python3 && rm -rf /var/lib/apt/lists/*
# The dependencies are a layer of their own: this one is built again only when a manifest or the lock file changes. The
# crates are empty meanwhile, with a file for every benchmark, because Cargo refuses a manifest whose targets are missing.
# rust-toolchain.toml stays out: it asks for tools of developers that the image lacks.
COPY Cargo.toml Cargo.lock ./
COPY science/Cargo.toml science/
RUN mkdir -p src science/src \
    && echo 'fn main() {}' > src/main.rs && touch src/lib.rs science/src/lib.rs \
    && for crate in . science; do mkdir -p "$crate/benches" \
         && for bench in $(sed -n '/^\[\[bench\]\]/{n;s/^name = "\(.*\)"/\1/p}' "$crate/Cargo.toml"); do \
              echo 'fn main() {}' > "$crate/benches/$bench.rs"; done; done \
    && cargo build --release --locked --bin pinstack
COPY science/src science/src
COPY src src
# the guide, which the program serves
COPY README.md ./
COPY docs docs
# newer than the empty crates: files keep their times when they are copied, and Cargo compares times
RUN touch src/main.rs src/lib.rs science/src/lib.rs && cargo build --release --locked --bin pinstack
COPY scripts/release/notices.py scripts/release/
RUN scripts/release/notices.py "$(rustc -vV | sed -n 's/^host: //p')" target/THIRD-PARTY.txt

# What the binary needs and nothing else: root certificates, a user, the licences, and the C library unless the binary is
# static. /var/lib/dpkg/status.d tells scanners the packages from which it came. A stage of its own, so that a static
# binary that exists already can take the place of the stage `build`: scripts/release/image.sh TARGET.
FROM ${RUST_IMAGE} AS files
WORKDIR /src
COPY LICENSE LICENSE-APACHE LICENSE-MIT ./
COPY --from=build /src/target/release/pinstack /src/target/THIRD-PARTY.txt ./
RUN set -eu; root=/rootfs; packages=ca-certificates; install -D -t $root/usr/local/bin pinstack \
    && for file in $(ldd pinstack | grep -o '/[^ ]*'); do \
         install -D "$file" "$root$file"; packages="libc6 libgcc-s1 ca-certificates"; done \
    && install -D -m 644 /etc/ssl/certs/ca-certificates.crt $root/etc/ssl/certs/ca-certificates.crt \
    && install -D -m 644 -t $root/usr/share/doc/pinstack LICENSE LICENSE-APACHE LICENSE-MIT THIRD-PARTY.txt \
    && mkdir -p $root/var/lib/dpkg/status.d \
    && for package in $packages; do \
         dpkg-query --status "$package" > "$root/var/lib/dpkg/status.d/$package"; \
         install -D -m 644 "$(readlink -f /usr/share/doc/$package/copyright)" "$root/usr/share/doc/$package/copyright"; done \
    && echo 'pinstack:x:10001:10001::/data:/sbin/nologin' > $root/etc/passwd \
    && echo 'pinstack:x:10001:' > $root/etc/group \
    && echo 'hosts: files dns' > $root/etc/nsswitch.conf \
    && install -d -m 1777 $root/tmp && install -d /empty

FROM scratch
COPY --from=files /rootfs/ /
# A fixed user id, so that a mounted folder can be owned by it: chown 10001 /srv/pinstack
COPY --from=files --chown=10001:10001 /empty /data
# In a container other machines may reach every address: without a token (pinstack token add, on /data) or
# PINSTACK_AUTH=none the server refuses to start, with a message.
USER 10001:10001
WORKDIR /data
ENV PINSTACK_LISTEN=0.0.0.0:8080 PINSTACK_DATA_DIR=/data PATH=/usr/local/bin
VOLUME /data
EXPOSE 8080
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=5s --timeout=5s --start-period=10s --retries=3 CMD ["/usr/local/bin/pinstack", "health"]
ENTRYPOINT ["/usr/local/bin/pinstack"]
CMD ["serve"]
ARG VERSION=unknown
ARG REVISION=unknown
LABEL org.opencontainers.image.title="pinstack" \
      org.opencontainers.image.description="Calibrated focus stacking for photogrammetry, as a service" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0" \
      org.opencontainers.image.version="${VERSION}" \
      org.opencontainers.image.revision="${REVISION}"
