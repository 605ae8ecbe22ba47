# docker build -t irbcal . && docker run --rm -v "$PWD:/data" irbcal demo
FROM python:3.12 AS build
COPY . /irbcal
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel /irbcal

FROM python:3.12-slim
COPY --from=build /wheel /wheel
COPY scripts/locks/demo.txt /wheel/demo.txt
RUN pip install --no-cache-dir --no-compile --no-deps --require-hashes -r /wheel/demo.txt \
    && pip install --no-cache-dir --no-deps /wheel/*.whl
WORKDIR /data
ENTRYPOINT ["irbcal"]
