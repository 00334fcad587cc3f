# CPU vision and orchestration: capture, keypoints, body, tracking, rendering; also the server and the parents of the pipeline.
# No stage uses a GPU: networks run in onnxruntime and torch on the CPU, Mitsuba in its LLVM variants.
# Build with containers/build.sh. BASE: any Debian 12 (or image with Python 3.11 on Debian), pinned by its digest:
#   --build-arg BASE=docker.io/library/debian:bookworm-slim@sha256:…
# TORCH_INDEX: where torch comes from; empty takes it from the index that pip is set to. PIP_…: as in pip's environment; see build.sh.
ARG BASE=docker.io/library/debian:bookworm-slim

FROM ${BASE} AS build
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
ARG PIP_INDEX_URL PIP_EXTRA_INDEX_URL PIP_FIND_LINKS PIP_CERT
ENV DEBIAN_FRONTEND=noninteractive PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
RUN apt-get update && apt-get install -y --no-install-recommends \
        ca-certificates gcc libc6-dev libsuitesparse-dev python3.11 python3.11-dev python3.11-venv
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE ./
RUN python3.11 -m venv /opt/physavatar \
    && /opt/physavatar/bin/pip install -q -c constraints.txt wheel setuptools cython hatchling "numpy>=2.4" \
    && /opt/physavatar/bin/pip install -q -c constraints.txt ${TORCH_INDEX:+--index-url $TORCH_INDEX} torch==2.13.0 \
    && /opt/physavatar/bin/pip install -q -c constraints.txt --no-build-isolation scikit-sparse==0.4.16 \
    && /opt/physavatar/bin/pip install -q -c constraints.txt --no-deps rtmlib==0.0.16
COPY flows flows
COPY tasks tasks
COPY storage_schemas storage_schemas
RUN /opt/physavatar/bin/pip install -q -c constraints.txt --no-build-isolation ".[demo]"
COPY deploy/prefect.yaml deploy/pools.yaml /opt/physavatar/lib/python3.11/site-packages/deploy/
# compiled once here: without it every flow run would compile Prefect again, or could not, in a read-only image
RUN find /opt/physavatar -name tests -type d -prune -exec rm -rf {} + \
    && /opt/physavatar/bin/python -m compileall -q -j 0 /opt/physavatar/lib || true

FROM ${BASE}
ARG DEBIAN_FRONTEND=noninteractive
# no compilers here; tini is process 1, so that killed children are reaped
RUN apt-get update && apt-get install -y --no-install-recommends \
        ca-certificates libatomic1 libcholmod3 libgomp1 libllvm19 libopenblas0-serial libumfpack5 libspqr2 python3.11 tini \
    && apt-get clean && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --create-home --home-dir /home/physavatar physavatar \
    && install -d -o physavatar /store /data
COPY --from=build /opt/physavatar /opt/physavatar
USER 10001:10001
WORKDIR /home/physavatar
ENV PATH=/opt/physavatar/bin:$PATH PHYSAVATAR_STORE=/store PHYSAVATAR_DATA=/data PHYSAVATAR_HOME=/home/physavatar/service \
    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
VOLUME ["/store"]
HEALTHCHECK --interval=30s --timeout=5s --start-period=120s --retries=3 \
    CMD test $(( $(date +%s) - $(stat -c %Y /home/physavatar/service/alive) )) -lt 60
ENTRYPOINT ["tini", "--"]
CMD ["physavatar", "worker", "vision"]
