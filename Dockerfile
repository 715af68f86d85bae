# One image per family of services: `docker compose build`, or `docker build --target sim .`
# Needs BuildKit. Pin BASE by digest where builds have to be the same in a year.
ARG BASE=python:3.11-slim-bookworm

# The base image's own pip takes no hashes from a constraints file; the one that is locked does.
FROM ${BASE} AS pip
COPY requirements-build.lock /
RUN --mount=type=secret,id=pipconf,target=/run/pip.conf \
    python3 -m venv /tools && \
    printf '#!/bin/sh\nPIP_CONFIG_FILE=/run/pip.conf HOME=/root exec /tools/bin/pip "$@"\n' \
      > /tools/run-pip && chmod +x /tools/run-pip && \
    /tools/run-pip install --quiet --require-hashes --only-binary=:all: -r /requirements-build.lock

# A wheel of nothing but the project's metadata, equal to the bit as long as they are: what is
# installed does not depend on the code, so a change of the code leaves the large layers alone.
FROM pip AS tools
WORKDIR /metadata
COPY pyproject.toml constraints.txt requirements.lock ./
RUN mkdir common && echo '__version__ = "0"' > common/__init__.py && touch README.md LICENSE && \
    SOURCE_DATE_EPOCH=315532800 /tools/run-pip wheel --quiet --no-deps --no-build-isolation \
      --wheel-dir /tools . && \
    cp constraints.txt requirements.lock /tools
# install-locked EXTRA: what the extra needs, in the version and with a hash of requirements.lock.
# Of another package, version or file the build fails; nothing is compiled.
RUN printf '%s\n' '#!/bin/sh' \
      'wheel=/tools/legato-0-py3-none-any.whl' \
      'hash=$(sha256sum "$wheel" | cut -d " " -f 1)' \
      'exec /tools/run-pip --python /venv/bin/python install --quiet --require-hashes \' \
      '  --only-binary=:all: -c /tools/requirements.lock "legato[$1] @ file://$wheel#sha256=$hash"' \
      > /tools/install-locked && chmod +x /tools/install-locked

FROM tools AS code
WORKDIR /source
COPY . .
RUN /tools/run-pip install --quiet --no-deps --no-build-isolation --target /code . && \
    rm -r /code/bin

# The policies that come with LEGATO are for those who serve them.
FROM code AS code-without-policies
RUN rm -r /code/policies

# What every service needs, one layer for all images. No pip and no compiler gets into them.
FROM ${BASE} AS core
ENV PATH=/venv/bin:$PATH \
    PYTHONPATH=/code \
    HOME=/tmp \
    LEGATO_HEARTBEAT=/tmp/heartbeat \
    OMP_NUM_THREADS=1 \
    OPENBLAS_NUM_THREADS=1
WORKDIR /tmp
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    python3 -m venv --without-pip /venv && /tools/install-locked router
HEALTHCHECK --interval=3s --timeout=3s --start-period=90s --retries=3 \
    CMD ["python", "-m", "common.health"]

FROM core AS router
COPY --from=code-without-policies /code /code
USER 10001:10001
EXPOSE 7447
ENTRYPOINT ["python", "-m", "services.router", "--listen=0.0.0.0:7447"]

FROM core AS gripper
COPY --from=code-without-policies /code /code
USER 10001:10001
ENTRYPOINT ["python", "-m", "services.gripper"]

FROM core AS sim
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    /tools/install-locked sim
COPY --from=code-without-policies /code /code
# The camera's kernels are compiled here, for any processor: code for the one that builds would be
# compiled again, for most of a minute, on every other. Numba reads its cache only where it can also
# write, so a start copies half a megabyte to /tmp.
ENV NUMBA_CPU_NAME=generic
RUN NUMBA_CACHE_DIR=/kernels python -m services.sim.camera
ENV NUMBA_CACHE_DIR=/tmp/kernels
USER 10001:10001
ENTRYPOINT ["/bin/sh", "-c", "cp -r /kernels /tmp/ && exec python -m services.sim --node=\"sim-$HOSTNAME\" \"$@\"", "sim"]

FROM core AS retarget
# Pinocchio's library asks for the one of OpenMP and does not bring it.
RUN apt-get update -q && apt-get install -q -y --no-install-recommends libgomp1 && \
    rm -rf /var/lib/apt/lists/* /var/cache/apt/*
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    /tools/install-locked retarget && \
    rm -r /venv/lib/python3*/site-packages/cmeel.prefix/include
COPY --from=code-without-policies /code /code
USER 10001:10001
ENTRYPOINT ["python", "-m", "services.retarget"]

# Whole evaluations in one process, for clusters: every service but torch, and the command line.
FROM core AS eval
RUN apt-get update -q && apt-get install -q -y --no-install-recommends libgomp1 && \
    rm -rf /var/lib/apt/lists/* /var/cache/apt/*
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    /tools/install-locked all && \
    rm -r /venv/lib/python3*/site-packages/cmeel.prefix/include
COPY --from=code /code /code
ENV NUMBA_CPU_NAME=generic
RUN NUMBA_CACHE_DIR=/kernels python -m services.sim.camera
ENV NUMBA_CACHE_DIR=/tmp/kernels
USER 10001:10001
HEALTHCHECK NONE
ENTRYPOINT ["/bin/sh", "-c", "cp -r /kernels /tmp/ && exec python -m client.main \"$@\"", "legato"]

FROM core AS policy
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    /tools/install-locked policy && \
    install -d -o 10001 -g 10001 /checkpoints
COPY --from=code /code /code
USER 10001:10001
ENTRYPOINT ["python", "-m", "services.policy", "--checkpoints=/checkpoints"]

# Torch is not in the lock: its builds for CPU and CUDA have different files.
FROM core AS policy-gpu
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    /tools/run-pip --python /venv/bin/python \
      install --quiet -c /tools/constraints.txt '/tools/legato-0-py3-none-any.whl[torch]' && \
    install -d -o 10001 -g 10001 /checkpoints
COPY --from=code /code /code
USER 10001:10001
ENTRYPOINT ["python", "-m", "services.policy", "--checkpoints=/checkpoints", \
    "--backend=torch", "--device=cuda:0"]

FROM core AS control
RUN --mount=type=bind,from=tools,source=/tools,target=/tools \
    --mount=type=secret,id=pipconf,target=/run/pip.conf \
    --mount=type=cache,target=/root/.cache/pip \
    /tools/install-locked control && \
    install -d -o 10001 -g 10001 /data
COPY --from=code-without-policies /code /code
USER 10001:10001
EXPOSE 8000
ENTRYPOINT ["python", "-m", "services.control", "--host=0.0.0.0", "--data=/data"]
