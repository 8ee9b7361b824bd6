# hilbridge on the simulated bus, or on a CAN interface of the host (docker run --network host --cap-add NET_RAW).
FROM python:3.11-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY . .
RUN python -m venv /opt/hilbridge && /opt/hilbridge/bin/pip install --no-cache-dir -c constraints.txt .

FROM python:3.11-slim
COPY --from=build /opt/hilbridge /opt/hilbridge
ENV PATH=/opt/hilbridge/bin:$PATH
RUN useradd --create-home wearer
USER wearer
WORKDIR /home/wearer
ENTRYPOINT ["hilbridge"]
CMD ["demo", "--seconds", "30"]
